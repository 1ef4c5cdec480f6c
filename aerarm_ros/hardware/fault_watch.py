"""Looks for whatever has to stop the arm, and says what the way out of it depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.board_link import ArmMeasurements, BoardLink
from aerarm_ros.hardware.boards.board_monitor import BoardMode
from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor
from aerarm_ros.hardware.boards.homing import EncoderZeros
from aerarm_ros.hardware.gate.safety_gate import SafetyGate
from aerarm_ros.hardware.heat_watch import HeatWatch


@dataclass(frozen=True)
class StoppedArm:
    """What of a stopped arm decides how it is brought back.

    Attributes
    ----------
    boards
        Number and name of each board that is in fault, or whose encoder is doubted.
    violation
        Whether it is beyond a limit, so that it would stop again at once.
    driven
        Whether all its motors are still driven and aligned.
    until_power_cycle
        Whether its boards keep an error until their supply was off.
    zero_unknown
        Whether an encoder counts from nobody knows where.
    absolute
        Whether all its encoders know their angles after a power cycle.
    latched
        Whether the stop is still latched; without it the arm is off, and its zero unknown.
    """

    boards: Sequence[tuple[int, str]] = ()
    violation: bool = False
    driven: bool = True
    until_power_cycle: bool = True
    zero_unknown: bool = False
    absolute: bool = False
    latched: bool = True


def way_out(arm: StoppedArm, emulated: bool) -> str:
    """Return what to do, one step after the other, divided by commas; commands are in quotes.

    Without a fault of a board or an encoder, and inside its limits, a driven arm is held where it
    is. All else goes through idle: a board that restarted has to align, and clearing a fault would
    not be accepted, or last. What has lost an encoder's zero, or will by a power cycle, is homed
    from its home configuration. Emulated boards are mended by a command; on real ones it is said
    what hands have to do.
    """
    if not arm.latched:
        return "'arm home'" if emulated else "bring the arm to its home configuration, 'arm home'"
    steps = []
    through_idle = bool(arm.boards) or arm.violation or arm.zero_unknown
    restarts = bool(arm.boards) and (emulated or arm.until_power_cycle)
    homes = (arm.zero_unknown or restarts) and not (arm.absolute and restarts)
    if through_idle:
        steps += ["'arm disable'"] if emulated else ['support the arm', "'arm disable'"]
    if emulated:
        steps += [f"'arm fault power_cycle:{number}'" for number, _ in arm.boards]
    elif arm.boards:
        steps.append('mend the cause')
        if arm.until_power_cycle:
            steps += [f'switch the supply of {name} off and on' for _, name in arm.boards]
    if not emulated and homes:  # where home and enable do it
        steps.append('bring the arm to its home configuration')
    elif not emulated and arm.violation:
        steps.append('move the arm inside its limits by hand')
    steps.append("'arm clear_fault'")
    if homes:
        steps.append("'arm home'")
    elif through_idle or not arm.driven:
        steps.append("'arm enable'")
    return ', '.join(steps)


class FaultWatch:
    """Watches boards, encoders and joints, and trips the gate's stop.

    Parameters
    ----------
    config
        The arm.
    gate, links, encoders, zeros, heat
        What is watched, and what is told.
    until_power_cycle
        Whether the boards keep an error until their supply was off.
    """

    def __init__(
        self,
        config: ArmConfig,
        gate: SafetyGate,
        links: Sequence[BoardLink],
        encoders: EncoderMonitor,
        zeros: EncoderZeros,
        heat: HeatWatch,
        until_power_cycle: bool,
    ) -> None:
        self._joints = config.joints
        self._gate = gate
        self._links = tuple(links)
        self._encoders = encoders
        self._zeros = zeros
        self._heat = heat
        self._until_power_cycle = until_power_cycle

    def refusal(self, driven: bool) -> str:
        """Return why the motors cannot be switched on, or are not well if `driven`; ''."""
        if self._gate.stop:
            return f'clear the fault first: {self._gate.stop}'
        silent = [
            f'{link.monitor.name} does not answer: {link.monitor.problem}'
            for link in self._links
            if link.monitor.mode is BoardMode.DISCONNECTED
        ]
        silent += [link.monitor.echo.warning for link in self._links if link.monitor.echo.is_cut]
        if silent:
            return '; '.join(silent)
        if not driven and any(link.state.system_enabled for link in self._links):
            return 'the boards are still switching off: try again'
        return '' if driven else self._heat.refusal()

    def boards(self, enabled: bool) -> None:
        """Look for faults of boards, and for those that were switched off and on.

        An `enabled` arm that loses a zero is stopped, also if its motors are still driven.
        """
        for link in self._links:
            if link.monitor.mode is BoardMode.FAULT:
                self._gate.trip(link.monitor.fault)
            if link.restarted:
                joints = [joint for joint, _ in link.joints]
                name = link.monitor.name
                self._zeros.restarted(joints, f'{name} was switched off and on')
                if enabled and self._zeros.are_lost:
                    self._gate.trip(
                        f'{name} restarted while it was enabled, or its clock jumped: the zeros of '
                        'its encoders are unknown, check its supply and its ground wire'
                    )

    def joints(
        self,
        state: ArmMeasurements,
        now: float,
        feed_forward: Sequence[float],
        noise: Sequence[float],
    ) -> None:
        """Look at encoders and joints whose motors are driven.

        Parameters
        ----------
        state
            What the boards report.
        now
            Time [s].
        feed_forward, noise
            n each, as of `EncoderMonitor.check` [A].
        """
        gate, encoders = self._gate, self._encoders
        text = encoders.check(
            state.motor_position,
            state.motor_current,
            state.fresh,
            now,
            feed_forward,
            noise,
            state.interval_max,
            gate.inertias,
            gate.loads,
        )
        if text:
            gate.trip(text)
        if not encoders.trusted.all():  # the second look comes later
            self._zeros.lose(encoders.lost, 'its encoder jumped or stood still')
        violation = gate.state_violation(state.q, state.dq)
        if violation:
            gate.trip(violation)

    def stopped(self, state: ArmMeasurements, driven: bool) -> StoppedArm:
        """Return what decides how the arm is brought back; `driven` if all its motors are."""
        trusted = self._encoders.trusted.tolist()
        doubted = {
            joint.board for joint, known in zip(self._joints, trusted, strict=True) if not known
        }
        boards = [
            (number, link.monitor.name)
            for number, link in enumerate(self._links)
            if link.monitor.mode is BoardMode.FAULT or number in doubted
        ]
        return StoppedArm(
            boards,
            bool(self._gate.state_violation(state.q, state.dq)),
            driven,
            self._until_power_cycle,
            self._zeros.are_lost,
            all(self._zeros.absolute),
            bool(self._gate.stop),
        )
