"""Publish the diagnostics of a node that answers joint states, once per second."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.realtime.periodic_loop import TimingStatistics
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher, WaitingNotice, rejection
from aerarm_ros.ros.executors import create_steady_timer
from aerarm_ros.ros.graph import DuplicatePublisherCheck
from aerarm_ros.ros.states.state_stream import StateStream

# [s] for which a rejection is shown as a warning.
_REMEMBERED = 5.0
# [s] Longer than any latency within a host, so a larger value is a clock offset.
_LATENCY_MAX = 1.0
_SILENCE = 'no joint states received: check that the bridge runs'


class StateDiagnostics:
    """Publish one diagnostic status; the loop's thread only updates numbers.

    Parameters
    ----------
    node
        Owner of publisher and timer.
    warning
        Returns the node's own warning, or an empty text.
    values
        Returns the node's own values, by name.
    arm
        Name of the arm.
    notice
        Log notice about missing states; None for a node that logs it itself.
    every_state
        Whether the node should answer each state; if not, unanswered states are not counted.

    Attributes
    ----------
    latency
        Time from a state's publication to the computed answer, before a command is sent.
    rejections, last_rejection
        Number of rejected inputs, and reason of the last rejection.
    """

    def __init__(
        self,
        node: Node,
        warning: Callable[[], str],
        values: Callable[[], Mapping[str, object]],
        arm: str = '',
        notice: WaitingNotice | None = None,
        every_state: bool = True,
    ) -> None:
        self._node = node
        self._notice = notice
        self._every_state = every_state
        self._warning = warning
        self._values = values
        self._stream: StateStream | None = None
        self._received = 0
        self._rejected_at = -np.inf
        self.latency = TimingStatistics()
        self.rejections = 0
        self.last_rejection = ''
        self._sources = DuplicatePublisherCheck(node, topics.JOINT_STATES)
        self._output = DiagnosticsPublisher(node, arm, self._now_ns)
        create_steady_timer(node, PERIOD, self.publish)

    def watch(self, stream: StateStream) -> None:
        """Report on a stream of states from now on."""
        self._stream = stream

    def add_rejection(self, reason: str) -> None:
        """Count a rejected input."""
        self.rejections += 1
        self.last_rejection = reason
        self._rejected_at = time.monotonic()

    def account(self) -> str:
        """Return one summary line for the end of the log."""
        latency, skipped = self.latency.summary(), self._skipped()
        rejected = f'{self.rejections} inputs rejected'
        if not latency.count:
            received = self._stream.received if self._stream else 0
            came = (
                f'{received} states received, none answered' if received else ('no states received')
            )
            return f'{came}, {rejected}'
        unanswered = '' if skipped is None else f'{skipped} not answered, '
        return (
            f'{latency.count} states answered, {unanswered}{rejected}; '
            f'answer p50 {latency.p50 * 1e6:.0f} us, p99 {latency.p99 * 1e6:.0f} us after the state'
        )

    def publish(self) -> None:
        """Publish the status."""
        self._output.report(self._problem(), self._all_values())

    def _now_ns(self) -> int | None:
        """Return the time of the states [ns], None before the first."""
        return self._stream.stamp_ns if self._stream else None

    def _problem(self) -> str:
        news = self._sources.news()
        if news:
            self._node.get_logger().warning(news)
        received = self._stream.received if self._stream else 0
        is_silent, self._received = received == self._received, received
        if is_silent:
            self._say_waiting()
            return _SILENCE
        if time.monotonic() - self._rejected_at < _REMEMBERED:
            return rejection(self.last_rejection)
        return self._sources.problem() or self._clocks() or self._warning()

    def _clocks(self) -> str:
        """Return a warning if a latency reveals a clock offset between hosts, or an empty text."""
        latency = self.latency.summary()
        if not latency.count or (latency.p50 >= 0.0 and latency.p50 < _LATENCY_MAX):
            return ''
        return (
            "the clock of the states' publisher differs from this host's (median latency "
            f'{latency.p50:.3f} s), so latencies are invalid; run this node on the host of the '
            'bridge'
        )

    def _say_waiting(self) -> None:
        text = self._notice.update([_SILENCE], time.monotonic()) if self._notice else ''
        if text:
            self._node.get_logger().info(text)

    def _all_values(self) -> dict[str, object]:
        latency, skipped = self.latency.summary(), self._skipped()
        return {
            'states answered': latency.count,
            'states not answered': 'not counted' if skipped is None else skipped,
            'rejected inputs': self.rejections,
            'last rejection': self.last_rejection,
            'answer p50 [us]': round(latency.p50 * 1e6),
            'answer p99 [us]': round(latency.p99 * 1e6),
            'answer max [us]': round(latency.maximum * 1e6),
            **self._values(),
        }

    def _skipped(self) -> int | None:
        # Usually a newer state replaced the lost one before the loop read it.
        return self._stream.lost if self._stream and self._every_state else None
