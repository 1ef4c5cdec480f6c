"""Cycle of the bridge, which runs once per millisecond, without ROS and without a clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.hardware.boards.board_link import ArmMeasurements, MotorPower, make_links
from aerarm_ros.hardware.boards.commissioning_probe import CommissioningProbe
from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor
from aerarm_ros.hardware.boards.homing import EncoderZeros, ZeroSearch
from aerarm_ros.hardware.boards.kept_zeros import KeptZeros, ZeroRecall
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.bridge_modes import COMMANDABLE, Answer, to_switch_on
from aerarm_ros.hardware.fault_watch import FaultWatch, LoadWatch
from aerarm_ros.hardware.frames.frame_profile import FrameProfile, load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import (
    REJECTIONS,
    CommandBuffer,
    CommandIntake,
    OfferedCommand,
)
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.hardware.gate.safety_gate import LIMITED, SafetyGate
from aerarm_ros.hardware.heat_watch import HeatWatch
from aerarm_ros.model.dynamics import largest_gravity_load
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.hardware.boards.board_link import Transport

_RECENT = 1.0  # [s] time for which a rejected or limited command stays in the list of faults


_STEP_MAX = 0.005  # [s] longest time over which a reference moves in one cycle


class BridgeCycle:
    """Converts the joint command to board references and reads the joints, once per cycle.

    `mode` is one of `bridge_modes.MODES`; the module `bridge_modes` describes each mode.
    Requests (`enable`, `disable`, `home`, ...) take effect at the next update.

    Parameters
    ----------
    transport
        Open connection to the boards.
    settings
        Times and tolerances.
    profile
        Frame layout of the boards; by default the one that the configuration names.
    load_max
        (n,) or one for all: largest gravity torque [Nm] of each joint over all base orientations.
        Computed from `robot` by default. See `EncoderMonitor`.
    robot
        Robot model from which the barriers at the limits compute loads; by default the packaged
        arm.
    kept
        State stored by the previous bridge process (encoder zeros, temperatures), or the reason
        why it cannot be used.
    pulse_offset
        (n,) or one for all: motor angles of the index pulses modulo one turn [rad], see `Homing`.

    Raises
    ------
    ValueError
        If configuration, robot and frame profile contradict each other.

    Attributes
    ----------
    q, dq, tau
        Joint positions [rad], velocities [rad/s], torques from measured currents [Nm].
    motor_position, motor_velocity, motor_current, motor_power
        Motor positions [rad], velocities [rad/s], currents [A] and powers [W].
    state, power
        All measurements (`ArmMeasurements`), and power with energy and source (`MotorPower`).
    intake, gate
        Checks of received commands, and safety gate; each has counters.
    links, zeros, recall, probe
        Board links, encoder zeros, recall of stored zeros, and the commissioning probe.
    references
        References and gains of the motors.
    heat
        Estimated motor temperatures, and torque limits of warm motors.
    cycles
        Number of cycles executed.
    """

    def __init__(
        self,
        config: ArmConfig,
        transport: Transport,
        settings: BridgeSettings | None = None,
        profile: FrameProfile | None = None,
        load_max: ArrayLike | None = None,
        robot: Robot | None = None,
        kept: KeptZeros | str | None = None,
        pulse_offset: ArrayLike = 0.0,
    ) -> None:
        settings = settings or BridgeSettings()
        profile = profile or load_profile(config.profile)
        self.state = ArmMeasurements(config)
        self.power = MotorPower(config, profile)
        self.q, self.dq, self.tau = self.state.q, self.state.dq, self.state.tau  # updated in place
        self.motor_position = self.state.motor_position
        self.motor_velocity = self.state.motor_velocity
        self.motor_current = self.state.motor_current
        self.motor_power = self.power.watts
        self.intake = CommandIntake(
            config.joint_names, settings, effort_supported=profile.command.has('current')
        )
        robot = robot or load_robot(gravity_in_base=config.gravity_in_base)
        loads = JointLoads(config, robot)
        self.gate = SafetyGate(config, settings, loads)
        self.links = make_links(config, profile, settings, transport)
        self.mode, self.cycles = 'disconnected', 0
        self._config = config
        self._transport = transport
        self.references = MotorReferences(
            config, profile, settings.position_error_max, loads.damping_min
        )
        load_max = largest_gravity_load(robot) if load_max is None else load_max
        self._encoders = EncoderMonitor(config, settings.stall_time, load_max)
        self.zeros = EncoderZeros(config, profile.encoders)
        known = (self.zeros, self.links, self.references.zero)
        self.recall = ZeroRecall(config, *known, kept, pulse_offset)
        self.heat = HeatWatch(config, settings, profile, self.gate, self.links, self.references)
        self._loads = LoadWatch(config, robot, self.references)
        watched = (self.gate, self.links, self._encoders, self.zeros, self.heat)
        self._watch = FaultWatch(config, *watched, profile.errors_until_power_cycle)
        parts = (self.links, self.state, self.references, loads, self._watch.refusal)
        self.probe = CommissioningProbe(config, *parts)
        self._standstill = CommandBuffer.standstill(config.n)
        self._search = ZeroSearch(config, self.state, self.recall.pulse_offset)
        self._enabled = False
        self._aligned = False  # whether every motor in use was aligned at its board's last answer
        # whether the arm has followed a command since its motors became ready
        self._followed = False
        self._current_lag = settings.current_lag
        self._now = -np.inf

    @property
    def q_known(self) -> Array:
        """Joint positions (n,) [rad], NaN for joints whose encoder zero is unknown."""
        return self.zeros.known_only(self.q)

    @property
    def counters(self) -> dict[str, int]:
        """All counters of the bridge by their names in the diagnostics."""
        counts = {'cycles': self.cycles, 'commands accepted': self.intake.accepted}
        # copies, because the cycle adds new keys
        rejections, limited = dict(self.intake.rejections), dict(self.gate.limited)
        counts |= {f'rejected {key}': count for key, count in rejections.items()}
        counts |= {f'limited {key}': count for key, count in limited.items()}
        for link in self.links:
            monitor = link.monitor
            counts |= {f'{monitor.name} {key}': n for key, n in monitor.counters().items()}
        return counts

    @property
    def faults(self) -> list[str]:
        """All faults: the latched stop first, then recently rejected or limited commands."""
        intake, gate, now = self.intake, self.gate, self._now
        texts = [gate.stop, *(link.monitor.fault for link in self.links)]
        for link in self.links:
            monitor = link.monitor
            if link.is_damped_without_answer:
                texts.append(
                    f'{monitor.name} sends no valid frames ({monitor.problem}); the bridge '
                    'commands the board to damp its joints, and to switch its motors off once '
                    'the arm is disabled'
                )
            elif monitor.is_silent or not monitor.is_connected:
                texts.append(f'no answer from {monitor.name}: {monitor.problem}')
            elif not monitor.fault:
                texts.append(monitor.echo.warning)
        if self.mode in ('unhomed', 'fault'):
            texts.append(self.zeros.problem)
        if self.mode == 'damping':
            texts.append(
                f'no valid command for {intake.age(now):.2f} s, so the bridge damps the arm: '
                'check that the controller runs'
            )
        texts += [*self.heat.warnings(), *self._loads.warnings()]
        if now - intake.last_rejection_time < _RECENT:
            texts.append(f'a command was rejected: {REJECTIONS[intake.last_rejection]}')
        if now - gate.last_limited_time < _RECENT:
            texts.append(LIMITED[gate.last_limited])
        return list(dict.fromkeys(filter(None, texts)))

    def recovery_hint(self, emulated: bool) -> str:
        """Return the steps by which the user recovers a stopped arm; '' if it is not stopped."""
        if not self.gate.stop and (self._enabled or not self.zeros.are_lost):
            return ''
        return self._watch.recovery_hint(self.state, self._enabled and self._aligned, emulated)

    def command(self, offered: OfferedCommand, now: float) -> bool:
        """Process a joint command received at `now` [s], on the monotonic clock of `update`.

        Returns False if the command was rejected; `intake.rejections` counts the reason.
        """
        ready = self.mode in COMMANDABLE
        return self.intake.offer(offered, now, ready=ready)

    def enable(self) -> Answer:
        """Request that the boards align and drive the motors. The arm moves, so support it."""
        refusal = self.probe.refusal or self._watch.refusal(self._enabled)
        if self._enabled and not refusal:
            return self._hold()
        refusal = refusal or self.zeros.problem or self.gate.alignment_refusal(self.q, self.dq)
        if refusal:
            return Answer(False, refusal)
        self._align()
        return Answer(
            True, 'the motors align now and the arm moves: support the arm until arm_mode is ready'
        )

    def _align(self) -> None:
        self._enabled, self.mode = True, 'aligning'
        self._followed = False
        self.intake.forget()
        self._encoders.clear()

    def _hold(self) -> Answer:
        """Hold a damped arm at its present position; let an arm that follows a command continue."""
        if self.intake.is_fresh(self._now):
            return Answer(True, 'already enabled: the arm follows a command')
        self._followed = False
        return Answer(True, 'already enabled: the bridge holds the arm in place')

    def hold(self) -> Answer:
        """Request that the bridge hold the arm when commands end, instead of damping it."""
        if self.mode not in ('ready', 'running', 'damping'):
            first = "'arm clear_fault'" if self.gate.stop else to_switch_on(self.mode)
            return Answer(False, f'arm_mode is {self.mode}: run {first} first')
        self.intake.conclude(self._now)
        if self.intake.is_fresh(self._now):
            return Answer(True, 'the bridge holds the arm in place once commands end')
        return Answer(True, 'the bridge holds the arm in place')

    def disable(self) -> Answer:
        """Request that the boards switch the motors off. The arm falls, so support it."""
        self._enabled = False
        self._search.end()
        self.probe.end('the motors were disabled')
        self.intake.forget()
        return Answer(True, 'the motors are off')

    def clear_fault(self) -> Answer:
        """Leave the mode fault: hold the arm if its motors are driven, otherwise go to idle."""
        silent = [link.monitor.name for link in self.links if link.monitor.is_silent]
        if silent and self._enabled:
            # Without a known zero, leaving the fault mode would switch off the boards that damp
            # the arm.
            return Answer(
                False,
                f'no answer from {", ".join(silent)}: disable the arm first, or repair '
                'the connection',
            )
        # Motors that lost their alignment align again only on request.
        stays = self._enabled and all(link.may_be_damped for link in self.links)
        if stays and self.zeros.are_lost:
            return Answer(False, f'support the arm and disable it first: {self.zeros.problem}')
        violation = self.gate.state_violation(self.q, self.dq) or self.heat.refusal()
        if violation and self._enabled:
            return Answer(
                False, f'the bridge would stop the arm again at once, because {violation}'
            )
        reasons = [link.monitor.clear(link.state) for link in self.links]
        if any(reasons):
            return Answer(False, '; '.join(filter(None, reasons)))
        self.gate.release()
        self._encoders.clear()
        self.intake.forget()
        self._followed, self._enabled = False, stays
        return Answer(True, 'the arm is held' if stays else 'the motors are off')

    def home(self) -> Answer:
        """Start homing; the arm moves, because each motor turns by up to one turn to each side.

        The arm must be in its home configuration. Motors that are off are aligned first.
        """
        state, zeros = self.state, self.zeros
        is_held = self.mode in COMMANDABLE
        if not is_held and self._enabled:
            return Answer(False, f'the arm is {self.mode}, but homing needs ready or idle')
        refusal = '' if is_held else self.probe.refusal or self._watch.refusal(driven=False)
        refusal = self._search.problem or refusal or zeros.refusal(state.motor_position)
        if not is_held and not refusal:
            refusal = self.gate.alignment_refusal(np.array(self._config.rest_position), self.dq)
        if refusal:
            return Answer(False, refusal)
        if is_held:
            self._search.begin(zeros.expected(state.motor_position))
            self.intake.forget()
            self._followed = False
        else:
            # Until a pulse is found, the joint angles are those of the home configuration, as the
            # user asserts.
            expected = zeros.expected(state.motor_position)
            zeros.lose(range(self._config.n), 'homing did not end')
            self._set_zero(state.reported_position - expected)
            self._align()
            self._search.wait()
        align = '' if is_held else 'the motors align, then '
        return Answer(True, f'{align}{self._search.motion}; {zeros.assumed_home()}')

    def e_stop(self, reason: str) -> Answer:
        """Latch an emergency stop, which damps the arm until `clear_fault`."""
        self.gate.trip(f'emergency stop: {reason}')
        return Answer(True, 'the arm is damped')

    def update(self, now: float) -> None:
        """Run one cycle of the bridge at the time `now` [s, monotonic]."""
        elapsed = now - self._now if now > self._now else 0.0
        self._now = now
        self.cycles += 1
        self._transport.advance(now)
        # A board answers before it reads the command, so its answer results from the previous
        # command.
        gains, feed_forward = self.references.gains, self.references.feed_forward
        noise = self.references.braking_noise
        running = self._choose_references(now, elapsed)
        probed = self.probe.drive(now, self.gate.stop)
        for link in self.links:
            enable = self._enabled and not (self.gate.stop and not link.may_be_damped)
            link.exchange(self.references, enable or link is probed, running)
        self.references.note_sent()
        self._aligned = True
        for link in self.links:
            self._aligned = self._aligned and link.is_aligned
        self.state.read(self.links, self.references.zero, gains, self._current_lag)
        if self.recall.is_on and self.recall.look():
            self._set_zero(self.references.zero)
        dt = _STEP_MAX if elapsed > _STEP_MAX else elapsed
        self.power.update(self.motor_current, self.motor_velocity, self.state.motor_voltage, dt)
        self.heat.update(self.state, elapsed, self._enabled)
        self.probe.look(now)
        self._look_for_faults(now, feed_forward, noise)
        self.mode = self._current_mode(now)
        self._loads.update(self.mode == 'ready', self.state)

    def shutdown(self) -> None:
        """Switch the motors of all boards off; each board receives the frame twice."""
        self.disable()
        self.mode = 'idle'
        for _ in range(2):
            for link in self.links:
                link.switch_off()

    def _choose_references(self, now: float, elapsed: float) -> bool:
        """Select this cycle's motor references; return whether the arm follows a command."""
        references, gate, state = self.references, self.gate, self.state
        if not self._enabled:
            references.switch_off()
            gate.reset_barriers()
            return False
        if references.integrates:
            references.wind_up(self.q + 0.5 * elapsed * self.dq, elapsed)
        # A barrier would drive a joint whose position readings are wrong.
        times = state.age(now, now - elapsed)
        reliable = state.has_answered
        if self._encoders.has_doubts:
            rows = zip(self._encoders.is_position_reliable.tolist(), reliable, strict=True)
            reliable = [is_reliable and has_answered for is_reliable, has_answered in rows]
        q, dq = state.reliable_motion(reliable)
        kept = references.kept_torques(q, dq, state.unconfirmed)
        gate.watch(q, dq, references.torques(q, dq), *times, kept, state.unconfirmed)
        trusted = state.driven
        if False in reliable:
            rows = zip(reliable, state.driven, strict=True)
            trusted = [is_reliable and is_driven for is_reliable, is_driven in rows]
        dt = _STEP_MAX if elapsed > _STEP_MAX else elapsed
        return self._follow(now, dt, trusted)

    def _follow(self, now: float, dt: float, trusted: Sequence[bool]) -> bool:
        """Follow the command or damp the arm; return whether the arm follows a command."""
        references, gate = self.references, self.gate
        command = None if gate.stop else self._current_command(now)
        is_braked = command is not None and gate.follow(
            command, self.q, dt, now, references.motors, trusted
        )
        is_followed = command is not None and not gate.stop
        if not is_followed:
            gate.restart()
            references.damp(self._encoders.damping_speed)
            is_braked = references.keep_within(gate.barriers, trusted)
        if is_braked:
            gate.note_braking(now)
        return is_followed and self._followed

    def _current_command(self, now: float) -> CommandBuffer | None:
        """Return the command that the arm must follow; None if the bridge must damp the arm."""
        if not self._aligned:
            return None
        if self._search.is_on:
            return self._search_on()
        if self.intake.is_fresh(now):
            self._followed = True
            return self.intake.command
        if self.intake.is_concluded:
            self._followed = False
        return None if self._followed else self._standstill

    def _search_on(self) -> CommandBuffer:
        homing = self._search.update()
        if homing.is_done:
            self._search.end()
            if homing.fault:
                self.gate.trip(homing.fault)
                self.zeros.lose(homing.doubted, 'homing found implausible index pulses')
            else:
                self._set_zero(homing.zero)
                self._encoders.clear()
                self.zeros.found()
        return homing.command

    def _set_zero(self, zero: Array) -> None:
        """Set the encoder zeros: angles (n,) [rad] that the boards report at motor angle zero."""
        self.references.set_zero(zero)
        self.state.read(self.links, zero, self.references.gains)

    def _look_for_faults(
        self, now: float, feed_forward: Sequence[float], noise: Sequence[float]
    ) -> None:
        self._watch.boards(self._enabled)
        if self._enabled and self._aligned:
            self._watch.joints(self.state, now, feed_forward, noise)
        elif self._enabled:
            self.gate.watch_alignment(self.dq)
        if self.gate.stop:
            self._search.end()

    def _current_mode(self, now: float) -> str:
        if self.gate.stop:
            return 'fault'
        for link in self.links:
            if not link.monitor.is_connected:
                return 'disconnected'
        if not self._enabled:
            off = 'unhomed' if self.zeros.are_lost else 'idle'
            return 'commissioning' if self.probe.is_driving else off
        if not self._aligned:
            return 'aligning'
        if self._search.is_on:
            return 'homing'
        if not self._followed:
            return 'ready'
        return 'running' if self.intake.is_fresh(now) else 'damping'
