"""Clock with the time of the joint states' stamps, for nodes that work between joint states."""

from __future__ import annotations

import time
from math import inf

from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import decode_joint_state
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.realtime.periodic_loop import SteadyClock

# [s] without a joint state after which the clock returns the system time.
_SILENCE = 1.0


class ArmClock:
    """Clock that extrapolates the stamps of `joint_states`; use each instance in one thread only.

    Without joint states this clock returns the system time. If the system clock is set while the
    motors are on, the stamps do not follow the step, and differ from the system time.

    Parameters
    ----------
    node
        Owner of the subscription, which no executor needs to serve.
    """

    def __init__(self, node: Node) -> None:
        self._reader = RawReader(node, topics.JOINT_STATES)
        self._arrival = -inf
        self._ahead_ns = 0
        self._clock = SteadyClock(self._newest_ns)

    def now_ns(self) -> int:
        """Return the present time of the arm [ns since the epoch]."""
        return self._clock.now_ns()

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._reader.destroy()

    def _newest_ns(self) -> int:
        """Return the stamp of the newest joint state plus the time since its arrival [ns]."""
        now_ns = time.monotonic_ns()
        message = self._reader.take_newest()
        if message is not None:
            payload, info = message
            arrival_ns = monotonic_ns(info['received_timestamp'])
            try:
                self._ahead_ns = decode_joint_state(payload)[1].stamp_ns - arrival_ns
                self._arrival = 1e-9 * arrival_ns
            except ValueError:
                pass  # Nodes that use the joint state report the error.
        if 1e-9 * now_ns - self._arrival > _SILENCE:
            return time.time_ns()
        return now_ns + self._ahead_ns


def monotonic_ns(system_ns: int) -> int:
    """Convert a system time of the last second to a time on the monotonic clock [ns].

    If the system clock was set in the meantime, return the present time.
    """
    age_ns = time.time_ns() - system_ns
    return time.monotonic_ns() - (age_ns if 0 <= age_ns < 1e9 * _SILENCE else 0)
