"""Diagnostic statuses and log lines of the bridge."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf, isfinite
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from aerarm_ros.hardware.boards.board_link import resistance_by_boards
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.realtime.periodic_loop import (
    WARN,
    PeriodicLoop,
    SteadyClock,
    TimingStatistics,
    TimingSummary,
)
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher
from aerarm_ros.ros.executors import create_steady_timer

if TYPE_CHECKING:  # `hardware_bridge` imports this module
    from aerarm_ros.ros.bridge.hardware_bridge import HardwareBridge

# [s] A larger difference between the stamps and the system clock causes a warning.
_BEHIND_MAX = 0.02
# Names of statistics that differ from the fields of `TimingSummary`.
_STATISTICS = {'p99.9': 'p999', 'max': 'maximum'}
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class BridgeTiming:
    """Collect timing statistics of the bridge's cycle and of the received commands.

    Parameters
    ----------
    loop
        Loop of the bridge's cycle.
    stamps
        Clock for the stamps of the joint states.
    """

    def __init__(self, loop: PeriodicLoop, stamps: SteadyClock) -> None:
        self.loop, self._stamps = loop, stamps
        self._command_age = TimingStatistics()
        self._answered = 0
        self._summaries: dict[str, TimingSummary] = {}

    def add_command(self, age_ns: int, answers_last_state: bool) -> None:
        """Count a command, and store the age [ns] of the joint state that the command answers."""
        self._command_age.add(age_ns)
        self._answered += answers_last_state

    def refresh(self) -> Iterator[None]:
        """Compute the statistics for `status`, one per iteration of this generator (0.1 ms)."""
        loop, names = self.loop, ('period', 'wake lateness', 'execution time', 'command age')
        statistics = loop.interval, loop.lateness, loop.execution, self._command_age
        for name, one in zip(names, statistics, strict=True):
            self._summaries[name] = one.summary()
            yield

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Return level, message and values of the timing status from the last `refresh`."""
        loop, summaries = self.loop, self._summaries
        level, text = loop.assess(summaries['period'], summaries['execution time'])
        behind = self._stamps.behind
        if abs(behind) > _BEHIND_MAX:
            level = max(level, WARN)
            text = f'{text}; {_behind_text(behind)}'
        values: dict[str, object] = {
            'cycles': loop.cycles,
            'missed cycles': loop.missed,
            'commands answering the last state': self._answered,
            'stamps behind the system clock [ms]': f'{1e3 * behind:.1f}',
        }
        for name, summary in summaries.items():
            for key in ('mean', 'std', 'p50', 'p99', 'p99.9', 'max'):
                seconds = getattr(summary, _STATISTICS.get(key, key))
                values[f'{name} {key} [us]'] = f'{seconds * 1e6:.0f}'
        return _LEVELS[level], text, values


def _behind_text(behind: float) -> str:
    where = 'behind' if behind > 0.0 else 'ahead of'
    return (
        f'the stamps of joint_states are {1000.0 * abs(behind):.0f} ms {where} the system clock, '
        'because the system clock was set. Until both clocks agree, use neither start times nor '
        "stamps of the system clock. The next 'arm disable' corrects a difference above 500 ms; a "
        'smaller difference shrinks by 0.5 ms per second'
    )


_END = object()
# Name of the part, level, text and values.
Status = tuple[str, bytes, str, Mapping[str, object]]
MOTORS = 'motors'
"""Name of the diagnostic status that contains the values of the motors."""
POWER_FROM = 'power from'
"""Diagnostics key under which the bridge states how it computes the motor power."""
_POWER_SOURCES = {
    'voltage': 'power computed from the voltages that the boards report',
    'model': (
        'power computed from current, resistance and speed, because the boards report no voltage'
    ),
}


class BridgeDiagnostics:
    """Publish the bridge's diagnostics: state of the arm, motors, and timing of the cycle.

    Building a message takes most of a millisecond. While the bridge is active, the message is
    therefore built in steps, one after each cycle. Building it in another thread would hold the
    interpreter lock and delay nearly every cycle.

    Parameters
    ----------
    node
        Owner of the publisher. While the bridge is inactive, its executor publishes once per
        second.
    now_ns
        Returns the time for stamps [ns].
    """

    def __init__(self, node: Node, now_ns: Callable[[], int]) -> None:
        self._output = DiagnosticsPublisher(node, now_ns=now_ns)
        self._watched: HardwareBridge | None = None
        self._pieces: Iterator[None] | None = None
        self._due = -inf
        self._timer = create_steady_timer(node, PERIOD, self._publish_inactive)

    def name_arm(self, name: str) -> None:
        """Set the name of the arm in all later diagnostics."""
        self._output.arm = name

    def watch(self, bridge: HardwareBridge) -> None:
        """Publish the values of an active bridge, whose cycle must call `step` from now on."""
        self._timer.cancel()
        self._pieces = None
        self._watched = bridge
        self.publish_soon()

    def unwatch(self) -> None:
        """Publish the status 'not active' once per second from now on."""
        self._watched = None
        self._timer.reset()
        self._publish_inactive()

    def publish_soon(self) -> None:
        """Start a new message at the next call of `step`, because a value has changed."""
        self._due = -inf

    def step(self, now: float) -> None:
        """Build the next part of the message at the monotonic time `now` [s], in about 0.1 ms.

        A new message starts once per second, or after `publish_soon`.
        """
        if self._pieces is None:
            if now < self._due or self._watched is None:
                return
            self._due = now + PERIOD
            self._pieces = self._make(self._watched)
        if next(self._pieces, _END) is _END:
            self._pieces = None

    def _make(self, bridge: HardwareBridge) -> Iterator[None]:
        assert bridge.timing and bridge.cycle  # the bridge is active
        yield from bridge.timing.refresh()
        timing = self._output.status('timing', *bridge.timing.status())
        yield
        motors = self._output.status(MOTORS, *_motors(bridge.cycle, bridge.config.joint_names))
        yield
        arm = self._output.status('arm', *_arm(bridge, bridge.cycle))
        yield
        others = [self._output.status(*status) for status in bridge.world.statuses()]
        self._output.publish([arm, motors, timing, *others])

    def _publish_inactive(self) -> None:
        status = self._output.status('arm', DiagnosticStatus.STALE, 'not active', {})
        self._output.publish([status])


def _arm(bridge: HardwareBridge, cycle: BridgeCycle) -> tuple[bytes, str, dict[str, object]]:
    publishers, unknown = bridge.command_publishers, ', '.join(cycle.zeros.unknown)
    warnings = [bridge.duplicates.problem, publishers.warning]
    warnings += [bridge.zero_file.problem, bridge.record.problem]
    texts = [*cycle.faults, *filter(None, warnings), *bridge.publisher_watch.problems]
    level = DiagnosticStatus.WARN if texts else DiagnosticStatus.OK
    if cycle.mode in ('fault', 'disconnected'):
        level = DiagnosticStatus.ERROR
    values = {
        'mode': cycle.mode,
        'zeros': f'unknown: {unknown}' if unknown else 'known',
        'recovery hint': cycle.recovery_hint(bridge.world.emulated),
        'publishers of joint_command': ', '.join(publishers.names) or 'none',
        **cycle.counters,
    }
    return level, '; '.join(texts) or cycle.mode, values


def resistance_key(joint: str) -> str:
    """Return the diagnostics key of the winding resistance that the board of a joint reports."""
    return f'{joint} resistance [ohm]'


def _heat(cycle: BridgeCycle, names: Sequence[str]) -> dict[str, object]:
    """Return the diagnostics of temperatures, thermal torque limits and supply voltages."""
    values: dict[str, object] = {}
    for name, limit in zip(names, cycle.heat.limits, strict=True):
        values[f'{name} winding [degC]'] = f'{limit.motor.winding:.1f}'
        values[f'{name} housing [degC]'] = f'{limit.motor.housing:.1f}'
        values[f'{name} torque limit [Nm]'] = f'{limit.effort_limit:.2f}'
        is_finite = isfinite(limit.remaining)
        values[f'{name} time to reduction [s]'] = f'{limit.remaining:.0f}' if is_finite else 'never'
    for link, supply in zip(cycle.links, cycle.heat.supplies, strict=False):
        values[f'{link.monitor.name} supply [V]'] = f'{supply.voltage:.2f}'
    return values


def _motors(cycle: BridgeCycle, names: Sequence[str]) -> tuple[bytes, str, dict[str, object]]:
    power, heat = cycle.power, cycle.heat
    values: dict[str, object] = {POWER_FROM: power.source}
    reported = resistance_by_boards(cycle.links, len(names)).tolist()
    for name, watts, joules in zip(names, power.watts.tolist(), power.energy.tolist(), strict=True):
        values[f'{name} power [W]'] = f'{watts:.2f}'
        values[f'{name} energy [J]'] = f'{joules:.1f}'
    values['energy [J]'] = f'{power.energy.sum():.1f}'
    for name, ohm in zip(names, reported, strict=True):
        if isfinite(ohm):
            values[resistance_key(name)] = f'{ohm:.5f}'
    values |= _heat(cycle, names)
    warnings = [*heat.warnings(), *heat.unknown]
    level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
    return level, '; '.join([*warnings, _POWER_SOURCES[power.source]]), values


def followed_by(text: str, sentence: str) -> str:
    """Append a sentence to a text, after a full stop if the text has no final mark."""
    end = '' if text.endswith(('.', '?', '!')) else '.'
    return f'{text}{end} {sentence}'


# [s] Connected boards answer much sooner. Modes that alternate faster are logged once per period.
_PATIENCE = 1.0
# Modes that can alternate, for example if a controller is nearly too slow.
_ALTERNATING = ('running', 'damping')
# Modes that are logged with their reason. `RejectionLog` logs the rejections of commands.
_WITH_REASON = ('disconnected', 'unhomed', 'damping', 'fault')
_SINKS = 'The arm sinks until a valid command arrives'


class ModeLog:
    """Log each new mode of the arm, with its reason and, for a fault, a recovery hint.

    The cycle only stores the mode, because logging takes up to a millisecond. The executor's thread
    writes the log line. Mode `disconnected` is logged after a delay, because no board answers in
    the first moments after a start.

    Parameters
    ----------
    node
        Owner of the log.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._noted: deque[tuple[str, Sequence[str], str]] = deque()
        self._news = node.create_guard_condition(self._write)
        self._mode = self._text = self._hint = ''
        self._logged_at: dict[str, float] = {}
        self._patience = create_steady_timer(node, _PATIENCE, self._write_later, autostart=False)

    def note(self, mode: str, reasons: Sequence[str] = (), recovery_hint: str = '') -> None:
        """Queue a new mode of the arm for the log; called from the cycle's thread."""
        self._noted.append((mode, reasons, recovery_hint))
        self._news.trigger()

    def warn(self, text: str) -> None:
        """Queue a warning for the log; called from the cycle's thread."""
        self._noted.append(('', (text,), ''))
        self._news.trigger()

    def _write(self) -> None:
        while self._noted:
            mode, reasons, recovery_hint = self._noted.popleft()
            if not mode:
                self._node.get_logger().warning(reasons[0])
                continue
            self._mode, self._hint = mode, recovery_hint
            has_reason = self._mode in _WITH_REASON and reasons
            self._text = f'{self._mode}: {"; ".join(reasons)}' if has_reason else self._mode
            self._patience.cancel()
            if self._mode == 'disconnected' or self._alternates():
                self._patience.reset()
            else:
                self._log()

    def _alternates(self) -> bool:
        since = time.monotonic() - self._logged_at.get(self._mode, -inf)
        return self._mode in _ALTERNATING and since < _PATIENCE

    def _write_later(self) -> None:
        self._patience.cancel()
        self._log()

    def _log(self) -> None:
        self._logged_at[self._mode] = time.monotonic()
        log = self._node.get_logger()
        # rclpy fixes the severity of each line of code that logs.
        if self._mode == 'fault':
            log.error(followed_by(self._text, f'To recover: {self._hint}'))
        elif self._mode == 'damping':
            log.warning(followed_by(self._text, _SINKS))
        elif self._mode in _WITH_REASON:
            log.warning(self._text)
        else:
            log.info(self._text)


# [s] for the look-up of several publishers of joint_command, which the log line then names.
_LOOK_UP = 0.5
# [s] without a rejection for a reason, after which that reason is logged again.
_QUIET = 1.0
# [s] between two log lines with the same reason.
_PERIOD = 10.0
# [s] after a change of mode, in which rejections are normal, because controllers receive the new
# mode some commands later.
_AFTER_CHANGE = 1.0
# Rejection reasons that concern the publishers of commands.
_OF_PUBLISHERS = ('source', 'not_allowed')


class RejectionLog:
    """Report rejected joint commands, at most once per reason in 10 s; called by the cycle.

    Parameters
    ----------
    warn
        Logs a warning without delay of the cycle.
    publishers_warning
        Returns a warning about the publishers of commands, or an empty string.
    """

    def __init__(self, warn: Callable[[str], None], publishers_warning: Callable[[], str]) -> None:
        self._warn = warn
        self._publishers_warning = publishers_warning
        self._rejected_at: dict[str, float] = {}
        self._begun: dict[str, float] = {}
        self._logged_at: dict[str, float] = {}
        self._mode = ''
        self._mode_since = -inf

    def update(self, intake: CommandIntake, mode: str, now: float) -> None:
        """Log a warning if the cycle at `now` [s] rejected a command for a new reason."""
        if mode != self._mode:
            self._mode, self._mode_since = mode, now
        if intake.last_rejection_time == now:
            self._note(intake.last_rejection, now)
        if not self._begun:  # in almost every cycle
            return
        for reason, begun in list(self._begun.items()):
            why = self._publishers_warning() if reason in _OF_PUBLISHERS else REJECTIONS[reason]
            # The name of a new publisher is not known yet.
            if not why and now - begun < _LOOK_UP:
                continue
            del self._begun[reason]
            if now - self._logged_at.get(reason, -inf) >= _PERIOD:
                self._logged_at[reason] = now
                self._warn(f'a command was rejected: {why or REJECTIONS[reason]}')

    def _note(self, reason: str, now: float) -> None:
        if reason == 'not_ready' and now - self._mode_since < _AFTER_CHANGE:
            return
        if now - self._rejected_at.get(reason, -inf) >= _QUIET:
            self._begun.setdefault(reason, now)
        self._rejected_at[reason] = now
