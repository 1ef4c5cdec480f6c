"""What the bridge tells about itself on /diagnostics, once a second and at every new mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.command_publishers import CommandPublishers
from aerarm_ros.nodes.bridge_timing import BridgeTiming

_LOOK = 0.1  # [s] between two looks at the mode
_LOOKS_MAX = 10  # without a message
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


class BridgeDiagnostics:
    """Publishes three statuses: what the arm does, its motors, how the loop keeps its time.

    Parameters
    ----------
    node
        Owner of publisher and timer; they are served outside the cycle's thread, which
        only adds numbers.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.qos
        )
        self._watched: Watched | None = None
        self._looks = 0
        self._mode = ''
        node.create_timer(_LOOK, self._look)

    def watch(self, watched: Watched | None) -> None:
        """Report on a cycle from now on, or on nothing."""
        self._watched = watched

    def _look(self) -> None:
        mode = self._watched.cycle.mode if self._watched else ''
        self._looks += 1
        if mode != self._mode or self._looks >= _LOOKS_MAX:
            self._mode, self._looks = mode, 0
            self._publish()

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        watched = self._watched
        if watched is None:
            message.status = [self._status('arm', DiagnosticStatus.STALE, 'not active', {})]
        else:
            message.status = [
                self._status('arm', *_arm(watched)),
                self._status('motors', *_motors(watched)),
                self._status('timing', *watched.timing.status()),
            ]
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
    texts = [*cycle.faults, *filter(None, [publishers.warning])]
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
