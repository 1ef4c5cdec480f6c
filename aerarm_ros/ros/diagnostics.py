"""Diagnostics of a node, and its log notices about missing inputs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import inf

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics

PERIOD = 1.0
"""Period of the diagnostics of a node [s]."""
TOOL_FORCE_PHASE, TOOL_FORCE = 'tool force', 'tool force [N]'
"""Diagnostics keys of `world_control` for the phase and the estimated force of a contact."""


_REMEMBERED = 5.0  # [s] for which diagnostics show a rejection as a warning


def rejection(reason: str) -> str:
    """Return the text about a rejected input, for log and diagnostics."""
    return reason if ' rejected' in reason else f'rejected: {reason}'


class Rejections:
    """Log rejected inputs of a node, and keep the newest for its diagnostics.

    Attributes
    ----------
    count
        Number of rejected inputs.
    """

    def __init__(self, node: Node) -> None:
        self.count, self._newest, self._at = 0, '', -inf
        self._logger = node.get_logger()

    def add(self, reason: str) -> None:
        """Count and log a rejected input."""
        self.count += 1
        self._newest, self._at = rejection(reason), time.monotonic()
        self._logger.warning(self._newest, throttle_duration_sec=1.0)

    @property
    def recent(self) -> str:
        """Text about the newest rejection for 5 s, then an empty string."""
        return self._newest if time.monotonic() - self._at < _REMEMBERED else ''


class DiagnosticsPublisher:
    """Create and publish the diagnostic statuses of a node on `/diagnostics`.

    Parameters
    ----------
    node
        Owner of the publisher.
    arm
        Name of the arm to which the statuses refer, '' if unknown.
    now_ns
        Returns the time for the stamp [ns], None if unknown. If the time is unknown, or without
        this argument, the stamp is the time of the node's clock.

    Attributes
    ----------
    arm
        Name of the arm, which may be set later.
    """

    def __init__(
        self, node: Node, arm: str = '', now_ns: Callable[[], int | None] = lambda: None
    ) -> None:
        self.arm = arm
        self._now_ns = now_ns
        self._node = node
        self._publisher = node.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.offered
        )

    def status(
        self, part: str, level: bytes, text: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        """Return the status of one part of the node; its hardware id is NAMESPACE/ARM."""
        namespace = self._node.get_namespace().strip('/')
        return DiagnosticStatus(
            level=level,
            name=f'{self._node.get_fully_qualified_name()}: {part}',
            message=text,
            hardware_id='/'.join(filter(None, (namespace, self.arm))),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )

    def publish(self, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish statuses with the present time as stamp."""
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._stamp()
        self._publisher.publish(message)

    def _stamp(self) -> Time:
        now_ns = self._now_ns()
        if now_ns is None:
            return self._node.get_clock().now().to_msg()
        seconds, nanoseconds = divmod(now_ns, 1_000_000_000)
        return Time(sec=seconds, nanosec=nanoseconds)

    def report(self, problem: str, values: Mapping[str, object], part: str = '') -> None:
        """Publish one status: a warning with the text `problem`, or OK if `problem` is empty."""
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        part = part or self._node.get_name()
        self.publish([self.status(part, level, problem or 'in order', values)])


# [s] after which a wait is reported, and between two reports of a wait.
PATIENCE, REPETITION = 2.0, 5.0


class WaitingNotice:
    """Generate a log notice about missing inputs after 2 s of waiting, then every 5 s.

    Parameters
    ----------
    now
        Start of the wait [s].
    """

    def __init__(self, now: float) -> None:
        self._due = now + PATIENCE

    def update(self, missing: Sequence[str], now: float) -> str:
        """Return a notice that lists `missing`, or an empty string if none is due."""
        if not missing or now < self._due:
            return ''
        self._due = now + REPETITION
        return f'waiting: {"; ".join(missing)}'
