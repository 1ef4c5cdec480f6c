"""Diagnostics, notices and progress of a node."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics

PERIOD = 1.0
'[s]; reporting period of a node without news.'


class DiagnosticsPublisher:
    """Makes statuses in the node's name, and publishes them.

    Parameters
    ----------
    node
        Owner of the publisher.
    arm
        Name of the arm that it works for, '' if it knows of none (yet).
    now_ns
        Returns the time for the stamp [ns], None where it is not known; the node's clock is asked
        then, and if this is not given.

    Attributes
    ----------
    arm
        As given; may change.
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
        """Return a status of a part of the node; its hardware is NAMESPACE/ARM."""
        namespace = self._node.get_namespace().strip('/')
        return DiagnosticStatus(
            level=level,
            name=f'{self._node.get_fully_qualified_name()}: {part}',
            message=text,
            hardware_id='/'.join(filter(None, (namespace, self.arm))),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )

    def publish(self, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish statuses, stamped now."""
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._stamp()
        self._publisher.publish(message)

    def _stamp(self) -> Time:
        now_ns = self._now_ns()
        if now_ns is None:
            return self._node.get_clock().now().to_msg()
        seconds, nanoseconds = divmod(now_ns, 1_000_000_000)
        return Time(sec=seconds, nanosec=nanoseconds)

    def report(self, problem: str, values: Mapping[str, object]) -> None:
        """Publish one status of the whole node: a warning if there is a problem."""
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        part = self._node.get_name()
        self.publish([self.status(part, level, problem or 'in order', values)])


# Shorter waits are ordinary [s]; what goes on is repeated as often as a person looks [s].
PATIENCE, REPETITION = 2.0, 5.0


class WaitingNotice:
    """Turns what is missing into a line now and then.

    Parameters
    ----------
    now
        When the wait begins [s].
    """

    def __init__(self, now: float) -> None:
        self._due = now + PATIENCE

    def update(self, missing: Sequence[str], now: float) -> str:
        """Return what to say at the time `now` [s], '' if nothing."""
        if not missing or now < self._due:
            return ''
        self._due = now + REPETITION
        return f'waiting: {"; ".join(missing)}'
