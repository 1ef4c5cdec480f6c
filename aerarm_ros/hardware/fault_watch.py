"""Detection of board, encoder and joint faults, and check of the arm's holding torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.boards.board_link import ArmMeasurements, BoardLink
from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor
from aerarm_ros.hardware.boards.homing import EncoderZeros
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.gate.safety_gate import SafetyGate
from aerarm_ros.hardware.heat_watch import HeatWatch
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.motion.signals import Array

_BY_HAND = 'move the arm by hand to its home configuration'


class FaultWatch:
    """Monitors boards, encoders and joints, and stops the arm through the gate after a fault.

    Parameters
    ----------
    gate, links, encoders, zeros, heat
        Parts to monitor, and the gate that stops the arm.
    until_power_cycle
        Whether the boards keep an error until their supply has been off.
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
        """Return why the motors cannot be switched on (or kept on, if `driven`), or ''."""
        if self._gate.stop:
            return f'clear the fault first: {self._gate.stop}'
        silent = [
            f'no answer from {link.monitor.name}: {link.monitor.problem}'
            for link in self._links
            if not link.monitor.is_connected
        ]
        silent += [link.monitor.echo.warning for link in self._links if link.monitor.echo.is_cut]
        if silent:
            return '; '.join(silent)
        if not driven and any(link.state.system_enabled for link in self._links):
            return 'the boards are still switching their motors off: try again after a second'
        return '' if driven else self._heat.refusal()

    def boards(self, enabled: bool) -> None:
        """Stop the arm if a board has a fault, and record boards that restarted.

        An `enabled` arm is stopped if the zero of an encoder is lost, even if its motors are
        still driven.
        """
        for link in self._links:
            if link.monitor.fault:
                self._gate.trip(link.monitor.fault)
            if link.restarted:
                joints = [joint for joint, _ in link.joints]
                name = link.monitor.name
                self._zeros.restarted(joints, f'{name} was switched off and on')
                if enabled and self._zeros.are_lost:
                    self._gate.trip(
                        f'{name} restarted while it was enabled, or its clock jumped, so the '
                        'zeros of its encoders are unknown: check its supply and its ground wire'
                    )

    def joints(
        self,
        state: ArmMeasurements,
        now: float,
        feed_forward: Sequence[float],
        noise: Sequence[float],
    ) -> None:
        """Stop the arm if an encoder or joint of a driven motor has a fault.

        Parameters
        ----------
        state
            Measurements reported by the boards.
        now
            Time [s].
        feed_forward, noise
            n motor currents each [A]; see `feed_forward` and `braking_noise` of
            `EncoderMonitor.check`.
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
        if encoders.has_doubts:  # a second reading follows later
            self._zeros.lose(encoders.lost, 'its encoder jumped or stopped counting')
        violation = gate.state_violation(state.q, state.dq)
        if violation:
            gate.trip(violation)

    def recovery_hint(self, state: ArmMeasurements, driven: bool, emulated: bool) -> str:
        """Return the steps by which the user recovers a stopped arm, with commands in quotes.

        A driven arm holds its position if no board or encoder is in fault and no limit is exceeded.
        In all other cases the motors must be switched off first, because a restarted board must
        align, and clearing the fault of a driven arm would fail. Joints with a lost encoder zero
        are homed from the home configuration. Emulated boards are repaired by a command; for real
        boards the hint names manual steps.

        Parameters
        ----------
        state
            Measurements reported by the boards.
        driven
            Whether all motors are still driven and aligned.
        emulated
            Whether the boards are emulated.
        """
        if not self._gate.stop:  # the motors are off, and a zero is unknown
            return "'arm home'" if emulated else f"{_BY_HAND}, 'arm home'"
        rows = zip(self._joints, self._encoders.trusted.tolist(), strict=True)
        doubted = {joint.board for joint, known in rows if not known}
        boards = [
            number
            for number, link in enumerate(self._links)
            if link.monitor.fault or number in doubted
        ]
        violation, lost = self._gate.state_violation(state.q, state.dq), self._zeros.are_lost
        through_idle = bool(boards or violation or lost or self._heat.wait)
        restarts = bool(boards) and (emulated or self._until_power_cycle)
        homes = (lost or restarts) and not (all(self._zeros.absolute) and restarts)
        steps = []
        if through_idle:
            steps += ["'arm disable'"] if emulated else ['support the arm', "'arm disable'"]
        if emulated:
            steps += [f"'arm fault power_cycle:{number}'" for number in boards]
        elif boards:
            steps.append('repair the cause')
            if restarts:
                names = [self._links[number].monitor.name for number in boards]
                steps += [f'switch the supply of {name} off and on' for name in names]
        # the commands home and enable move an emulated arm to its home configuration
        if not emulated and homes:
            steps.append(_BY_HAND)
        elif not emulated and violation:
            steps.append('move the arm inside its limits by hand')
        steps += [self._heat.wait] if self._heat.wait else []
        steps.append("'arm clear_fault'")
        if homes:
            steps.append("'arm home'")
        elif through_idle or not driven:
            steps.append("'arm enable'")
        return ', '.join(steps)


# One sample every `_CYCLES` cycles; the mean covers about one second.
_CYCLES = 20
_SAMPLES = 50
_MOVED = 0.01  # [rad] largest motion of a resting joint while the torque is averaged

# Friction can hold a part of the load: up to twice the configured friction, which commissioning
# accepts, plus the torque lost in the gear.
_FRICTION = 2.0
_GEAR_LOSS = 0.05
# Allowed deviation of an arm from its model: 25 % of mass, 10 % of size, a shifted mass
# distribution, and the error of the torque constants.
_MODEL_ERROR = 0.35
_SHIFT = 0.025  # [m]

_DELIVERY_ERROR = 0.25
# error of torques from offset and noise of the current measurement, relative to the largest
# torque
_CURRENT_ERROR = 0.05


class LoadCheck:
    """Compares the holding torques of a resting arm with those that its model predicts.

    Parameters
    ----------
    config
        Configuration with friction and rated payload.
    """

    def __init__(self, config: ArmConfig, robot: Robot) -> None:
        mass, *centre = config.rated_payload
        self._config = config
        # These models are not shared with the gate, because they carry other payloads.
        self._empty, self._loaded = Dynamics(robot), Dynamics(robot)
        self._loaded.carry(point_mass(mass, centre))
        masses = np.array(robot.inertial_parameters)[:, 0]
        carried = np.cumsum(masses[::-1])[::-1]
        shifted = _SHIFT * float(np.linalg.norm(config.gravity_in_base)) * carried
        self._allowed: Array = _FRICTION * config.column('coulomb') + shifted
        self._current_error: Array = _CURRENT_ERROR * config.column('effort_max')

    def warnings(self, q: Array, held: Array, requested: Array) -> list[str]:
        """Return warnings about joints whose torque deviates from the model or the request.

        Parameters
        ----------
        q
            (n,) positions [rad].
        held, requested
            (n,) joint torques from measured currents, and torques requested by the boards' law
            [Nm]; NaN if unknown.
        """
        empty, loaded = self._empty.gravity(q).copy(), self._loaded.gravity(q)
        lowest, highest = np.minimum(empty, loaded), np.maximum(empty, loaded)
        largest = np.maximum(np.abs(empty), np.abs(loaded))
        room = self._allowed + _MODEL_ERROR * np.abs(empty) + _GEAR_LOSS * largest
        differs = (held < lowest - room) | (held > highest + room)
        delivery_error = _DELIVERY_ERROR * np.abs(requested) + self._current_error
        fails = np.abs(requested - held) > delivery_error
        texts = []
        for i, name in enumerate(self._config.joint_names):
            if fails[i]:
                texts.append(
                    f'{name} delivers {held[i]:.2f} Nm, computed from its current, instead of '
                    f'the requested {requested[i]:.2f} Nm: check the driver of {name}, supply '
                    "and motor phases ('arm commission')"
                )
            elif differs[i]:
                texts.append(
                    f'{name} holds {held[i]:.2f} Nm, but the model predicts a load of '
                    f'{empty[i]:.2f} Nm, or {loaded[i]:.2f} Nm with the rated payload: check the '
                    'payload, what touches or supports the arm, gravity_in_base, and gear ratio, '
                    f"sign, driver and torque constant of {name} ('arm commission')"
                )
        return texts


class LoadWatch:
    """Averages the torques of an arm that holds its position, and checks them with `LoadCheck`.

    The first second is excluded, because a person may still support the arm. Each cycle adds at
    most one sample; the model is evaluated only when warnings are requested.

    Parameters
    ----------
    references
        References sent to the boards.
    """

    def __init__(self, config: ArmConfig, robot: Robot, references: MotorReferences) -> None:
        self._check = LoadCheck(config, robot)
        self._references = references
        self._means: Array | None = None
        self._judged: tuple[Array | None, list[str]] = None, []
        self._sums: Array = np.zeros((3, config.n))
        self._begin()

    def update(self, is_held: bool, state: ArmMeasurements) -> None:
        """Add the measurements of a cycle; `is_held` is true while the bridge holds the arm."""
        if not is_held:
            if self._cycle:
                self._begin()
            return
        self._cycle += 1
        if self._cycle % _CYCLES == 0:
            self._add(state)

    def warnings(self) -> list[str]:
        """Return the warnings about the joint torques of the held arm."""
        means = self._means
        if means is None:
            return []
        if self._judged[0] is not means:
            self._judged = means, self._check.warnings(*means)
        return self._judged[1]

    def _begin(self) -> None:
        self._cycle = 0
        self._means = None
        self._clear()
        self._count = -_SAMPLES

    def _clear(self) -> None:
        self._sums[:] = 0.0
        self._count = 0
        self._start: Array | None = None

    def _add(self, state: ArmMeasurements) -> None:
        if self._start is None:
            self._start = state.q.copy()
        elif np.abs(state.q - self._start).max() > _MOVED:
            self._begin()
            return
        self._count += 1
        if self._count <= 0:
            return
        motors = self._references.motors
        requested = self._references.torques(state.q, state.dq)
        # The integral term of a board is only estimated by the bridge.
        requested[[motor.integral_gain > 0.0 for motor in motors]] = np.nan
        self._sums += (state.q, state.tau, requested)
        if self._count == _SAMPLES:
            self._means = self._sums / _SAMPLES
            self._clear()
