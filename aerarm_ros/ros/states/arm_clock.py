"""The arm's time, for nodes that act between states."""

from __future__ import annotations

import time
from math import inf

from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import decode_joint_state
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.realtime.periodic_loop import SteadyClock

# [s] without a state, after which the system time is used.
_SILENCE = 1.0


class ArmClock:
    """Clock that continues the stamps of `joint_states`; only one thread may use it at a time.

    If the system clock is set while the motors are on, the stamps do not follow. The difference
    between stamps and system time is then wrong by that step. Without states this clock is the
    system time.

    Parameters
    ----------
    node
        Owner of the subscription; its executor does not serve the subscription.
    """

    def __init__(self, node: Node) -> None:
        self._reader = RawReader(node, topics.JOINT_STATES)
        self._arrival = -inf
        self._ahead_ns = 0
        self._clock = SteadyClock(self._newest_ns)

    def now_ns(self) -> int:
        """Return the time [ns since the epoch]."""
        return self._clock.now_ns()

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._reader.destroy()

    def _newest_ns(self) -> int:
        """Return the stamp of the newest state plus its age [ns]."""
        now_ns = time.monotonic_ns()
        message = self._reader.take_newest()
        if message is not None:
            payload, info = message
            arrival_ns = monotonic_ns(info['received_timestamp'])
            try:
                self._ahead_ns = decode_joint_state(payload)[1].stamp_ns - arrival_ns
                self._arrival = 1e-9 * arrival_ns
            except ValueError:
                pass  # The code that uses the values reports the error.
        if 1e-9 * now_ns - self._arrival > _SILENCE:
            return time.time_ns()
        return now_ns + self._ahead_ns


def monotonic_ns(system_ns: int) -> int:
    """Convert a past system time to the monotonic clock [ns]; now, if the system clock was set."""
    age_ns = time.time_ns() - system_ns
    return time.monotonic_ns() - (age_ns if 0 <= age_ns < 1e9 * _SILENCE else 0)
