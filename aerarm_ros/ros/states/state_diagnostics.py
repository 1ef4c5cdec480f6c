"""Diagnostics, once per second, of a node that publishes a command for each joint state."""

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

# [s] for which a rejected input remains a warning.
_REJECTION_TIME = 5.0
# [s] A larger latency is a clock offset between two hosts.
_LATENCY_MAX = 1.0
_SILENCE = 'no joint states received: check that the bridge runs'


class StateDiagnostics:
    """Publish the status of one node on /diagnostics, once per second.

    The executor's thread publishes. The real-time loop only updates numbers.

    Parameters
    ----------
    node
        Owner of publisher and timer.
    stream
        Joint states whose numbers the status contains.
    warning
        Returns a further warning of the node, or an empty string.
    values
        Returns further values of the node, by name.
    arm
        Name of the arm.
    notice
        Log notice about missing joint states, None if the node itself logs the notice.
    every_state
        Whether the node should answer each joint state. If not, unanswered joint states are not
        counted.

    Attributes
    ----------
    latency
        Time from the publication of a joint state until its answer has been computed.
    rejections, last_rejection
        Number of rejected inputs, and reason of the last rejection.
    """

    def __init__(
        self,
        node: Node,
        stream: StateStream,
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
        self._stream = stream
        self._received = 0
        self._rejected_at = -np.inf
        self.latency = TimingStatistics()
        self.rejections = 0
        self.last_rejection = ''
        self._sources = DuplicatePublisherCheck(node, topics.JOINT_STATES)
        self._output = DiagnosticsPublisher(node, arm, lambda: stream.stamp_ns)
        create_steady_timer(node, PERIOD, self.publish)

    def add_rejection(self, reason: str) -> None:
        """Count a rejected input."""
        self.rejections += 1
        self.last_rejection = reason
        self._rejected_at = time.monotonic()

    def account(self) -> str:
        """Return a log line that summarizes answered joint states, rejections and latency."""
        latency, skipped = self.latency.summary(), self._skipped()
        rejected = f'{self.rejections} inputs rejected'
        if not latency.count:
            received = self._stream.received
            came = f'{received} joint states received, none answered'
            return f'{came if received else "no joint states received"}, {rejected}'
        unanswered = '' if skipped is None else f'{skipped} not answered, '
        return (
            f'{latency.count} joint states answered, {unanswered}{rejected}; latency of the answer '
            f'p50 {latency.p50 * 1e6:.0f} us, p99 {latency.p99 * 1e6:.0f} us'
        )

    def publish(self) -> None:
        """Publish the node's status."""
        self._output.report(self._problem(), self._all_values())

    def _problem(self) -> str:
        news = self._sources.news()
        if news:
            self._node.get_logger().warning(news)
        received = self._stream.received
        is_silent, self._received = received == self._received, received
        if is_silent:
            self._log_waiting()
            return _SILENCE
        if time.monotonic() - self._rejected_at < _REJECTION_TIME:
            return rejection(self.last_rejection)
        return self._sources.problem() or self._clocks() or self._warning()

    def _clocks(self) -> str:
        """Return a warning if this host's clock differs from the bridge's, or an empty string."""
        latency = self.latency.summary()
        if not latency.count or (latency.p50 >= 0.0 and latency.p50 < _LATENCY_MAX):
            return ''
        return (
            'the clock of this host differs from the clock of the host that publishes joint_states '
            f'(median latency {latency.p50:.3f} s), so latencies are invalid: run this node on the '
            'host of the bridge'
        )

    def _log_waiting(self) -> None:
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
        # Usually a newer joint state replaced the lost one before the loop could read it.
        return self._stream.lost if self._every_state else None
