"""What the bridge tells about itself on /diagnostics, once a second."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.realtime.timing_assessment import assess_timing
from aerarm_ros.realtime.timing_statistics import TimingStatistics
from aerarm_ros.realtime.timing_summary import TimingSummary

_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class BridgeDiagnostics:
    """Publishes two statuses: what the arm does and how the loop keeps its time.

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
        self.command_age = TimingStatistics()
        self._cycle: BridgeCycle | None = None
        self._loop: PeriodicLoop | None = None
        self._answered = 0
        node.create_timer(1.0, self.publish)

    def watch(self, cycle: BridgeCycle | None, loop: PeriodicLoop | None) -> None:
        """Report on a cycle and its loop from now on, or on nothing."""
        self._cycle, self._loop = cycle, loop
        self.command_age.reset()
        self._answered = 0

    def add_command(self, age_ns: int, answers_last_state: bool) -> None:
        """Count a command: time since the state it answers [ns], and whether that was the last."""
        self.command_age.add(age_ns)
        self._answered += answers_last_state

    def account(self) -> str:
        """Return one line about the loop, for the log's end."""
        loop = self._loop
        if loop is None:
            return 'no cycle ran'
        total = loop.cycles + loop.missed
        share = 100.0 * loop.missed / total if total else 0.0
        lateness = loop.lateness.summary()
        return (
            f'{loop.cycles} cycles, {loop.missed} missed ({share:.3f} %), woken '
            f'{_us(lateness.p50)} us late (median), {_us(lateness.p999)} us (99.9 %)'
        )

    def publish(self) -> None:
        """Publish the statuses."""
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        if self._cycle is None or self._loop is None:
            message.status = [self._status('arm', DiagnosticStatus.STALE, 'not active', {})]
        else:
            message.status = [self._arm(self._cycle), self._timing(self._loop)]
        self._publisher.publish(message)

    def _arm(self, cycle: BridgeCycle) -> DiagnosticStatus:
        faults = cycle.faults
        level = DiagnosticStatus.OK
        if cycle.mode in ('fault', 'disconnected'):
            level = DiagnosticStatus.ERROR
        elif faults:
            level = DiagnosticStatus.WARN
        text = '; '.join(faults) or cycle.mode
        return self._status('arm', level, text, {'mode': cycle.mode, **cycle.counters})

    def _timing(self, loop: PeriodicLoop) -> DiagnosticStatus:
        interval, execution = loop.interval.summary(), loop.execution.summary()
        level, text = assess_timing(loop.period_ns * 1e-9, interval, execution)
        values: dict[str, object] = {
            'cycles': loop.cycles,
            'missed cycles': loop.missed,
            'commands answering the last state': self._answered,
        }
        for name, summary in (
            ('period', interval),
            ('wake lateness', loop.lateness.summary()),
            ('execution time', execution),
            ('command age', self.command_age.summary()),
        ):
            values.update(_rows(name, summary))
        return self._status('timing', _LEVELS[level], text, values)

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


def _rows(name: str, summary: TimingSummary) -> dict[str, str]:
    fields = {
        'mean': summary.mean,
        'std': summary.std,
        'p50': summary.p50,
        'p99': summary.p99,
        'p99.9': summary.p999,
        'max': summary.maximum,
    }
    return {f'{name} {key} [us]': _us(value) for key, value in fields.items()}


def _us(seconds: float) -> str:
    return f'{seconds * 1e6:.0f}'
