"""What the bridge tells about itself on /diagnostics, once a second and at every new mode."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.command_publishers import CommandPublishers
from aerarm_ros.nodes.bridge_timing import BridgeTiming
from aerarm_ros.nodes.publisher_watch import PublisherWatch

_PERIOD = 1.0  # [s]
_END = object()
_POWER_SOURCES = {
    'voltage': 'power from the voltages that the boards report',
    'model': 'power computed from current, resistance and speed: the frames carry none',
}


@dataclass(frozen=True)
class Watched:
    """What there is to report while the bridge is active."""

    joint_names: Sequence[str]
    cycle: BridgeCycle
    timing: BridgeTiming
    publishers: CommandPublishers
    watch: PublisherWatch


class BridgeDiagnostics:
    """Publishes three statuses: what the arm does, its motors, how the loop keeps its time.

    A message takes most of a millisecond to make. While a cycle runs it is therefore made in
    pieces, one in each cycle's slack: made by another thread it would hold the interpreter
    while the cycle wants it, and cost a cycle nearly every time.

    Parameters
    ----------
    node
        Owner of the publisher; its executor's thread says once a second that no cycle runs.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.qos
        )
        self._watched: Watched | None = None
        self._pieces: Iterator[None] | None = None
        self._due = -inf
        self._timer = node.create_timer(_PERIOD, self._publish_inactive)

    def watch(self, watched: Watched) -> None:
        """Report on a cycle from now on, which calls `step`."""
        self._timer.cancel()
        self._pieces = None
        self._watched = watched
        self.publish_soon()

    def unwatch(self) -> None:
        """Report from now on that no cycle runs."""
        self._watched = None
        self._timer.reset()
        self._publish_inactive()

    def publish_soon(self) -> None:
        """Report with the next steps: something is new."""
        self._due = -inf

    def step(self, now: float) -> None:
        """Do a piece of the work, about 0.1 ms, if there is any at the time `now` [s]."""
        if self._pieces is None:
            if now < self._due or self._watched is None:
                return
            self._due = now + _PERIOD
            self._pieces = self._make(self._watched)
        if next(self._pieces, _END) is _END:
            self._pieces = None

    def _make(self, watched: Watched) -> Iterator[None]:
        yield from watched.timing.refresh()
        timing = self._status('timing', *watched.timing.status())
        yield
        motors = self._status('motors', *_motors(watched))
        yield
        arm = self._status('arm', *_arm(watched))
        yield
        self._publish([arm, motors, timing])

    def _publish_inactive(self) -> None:
        self._publish([self._status('arm', DiagnosticStatus.STALE, 'not active', {})])

    def _publish(self, statuses: Sequence[DiagnosticStatus]) -> None:
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _status(
        self, part: str, level: bytes, text: str, values: dict[str, object]
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f'{self._node.get_fully_qualified_name()}: {part}',
            message=text,
            hardware_id='aerarm',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _arm(watched: Watched) -> tuple[bytes, str, dict[str, object]]:
    cycle, publishers = watched.cycle, watched.publishers
    texts = [*cycle.faults, *filter(None, [publishers.warning]), *watched.watch.problems]
    level = DiagnosticStatus.WARN if texts else DiagnosticStatus.OK
    if cycle.mode in ('fault', 'disconnected'):
        level = DiagnosticStatus.ERROR
    values = {
        'mode': cycle.mode,
        'publishers of joint_command': ', '.join(publishers.names) or 'none',
        **cycle.counters,
    }
    return level, '; '.join(texts) or cycle.mode, values


def _motors(watched: Watched) -> tuple[bytes, str, dict[str, object]]:
    power = watched.cycle.power
    values: dict[str, object] = {}
    for name, watts, joules in zip(
        watched.joint_names, power.watts.tolist(), power.energy.tolist(), strict=True
    ):
        values[f'{name} power [W]'] = f'{watts:.2f}'
        values[f'{name} energy [J]'] = f'{joules:.1f}'
    values['energy [J]'] = f'{power.energy.sum():.1f}'
    return DiagnosticStatus.OK, _POWER_SOURCES[power.source], values
