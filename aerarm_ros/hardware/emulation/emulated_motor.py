"""Emulated motor with encoder, current control, alignment and thermal model."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, floor, pi, sin

import numpy as np

from aerarm_ros.description.drive_config import JointConfig, MotorConfig


@dataclass(frozen=True)
class AlignmentTiming:
    """Durations and current of a rotor's alignment by a field that turns forward and back.

    Attributes
    ----------
    forward, reverse, hold
        Durations [s] of the forward turn, the backward turn, and the hold at the end.
    current
        Current in the direction of the field [A].
    """

    forward: float = 0.5
    reverse: float = 0.5
    hold: float = 0.3
    current: float = 2.0

    @property
    def total(self) -> float:
        """Duration of the whole alignment [s]."""
        return self.forward + self.reverse + self.hold


COUNTS_PER_TURN = 4096
RAD_PER_COUNT = 2.0 * pi / COUNTS_PER_TURN
_COUNTS_PER_RAD = COUNTS_PER_TURN / (2.0 * pi)
# [rad/s] cut-off of the firmware's low-pass filter of the speed
_VELOCITY_BANDWIDTH = 2.0 * pi * 100.0


class EmulatedEncoder:
    """Emulated motor encoder with quantized angle, filtered speed and one index pulse per turn.

    Parameters
    ----------
    substep
        Time between two samples [s].
    zero
        True motor angle [rad] at which the encoder counts zero; None for the angle at the first
        sample.
    absolute
        Whether the encoder knows its angle after a restart; otherwise its count restarts at zero.
    pulse_offset
        True motor angle of an index pulse, modulo one turn [rad].

    Attributes
    ----------
    position, velocity
        Measured angle [rad] and speed [rad/s].
    index_detected, index_toggle
        Flag set at the first index pulse; bit that flips at each pulse.
    stuck
        Whether the fault is active in which the count no longer changes.
    """

    def __init__(
        self,
        substep: float,
        zero: float | None = 0.0,
        absolute: bool = False,
        pulse_offset: float = 0.0,
    ) -> None:
        self._substep = substep
        self._gain = 1.0 - exp(-_VELOCITY_BANDWIDTH * substep)
        self._shift = 0.0 if zero is None else -zero
        self._begins = zero is None  # the encoder counts from the first sampled angle
        self._shift_absolute = self._shift if absolute else None
        self._pulse_offset = pulse_offset
        self._angle: float | None = None
        self._turn = 0
        self.position = 0.0
        self.velocity = 0.0
        self.index_detected = False
        self.index_toggle = False
        self.stuck = False

    def sample(self, angle: float) -> None:
        """Measure the motor angle, given its true value [rad]; call once per sub-step."""
        if self._angle is None:
            self.place(angle)
        if self.stuck and self._angle is not None:
            angle = self._angle
        self._angle = angle
        turn = self._turns(angle)
        if turn != self._turn:
            self._pass_index()
            self._turn = turn
        position = self._quantised(angle)
        self.velocity += self._gain * ((position - self.position) / self._substep - self.velocity)
        self.position = position

    def place(self, angle: float) -> None:
        """Set the true motor angle [rad] without an effect on the measured speed."""
        if self._begins:
            self._shift, self._begins = -angle, False
        self._angle = angle
        self._turn = self._turns(angle)
        self.position = self._quantised(angle)
        self.velocity = 0.0

    def remount(self, angle: float) -> None:
        """Mount the encoder on another motor, at its shaft angle [rad]; keep the count."""
        if self._angle is None:
            return  # the encoder has not begun to count
        self._shift += self._angle - angle
        self._angle = angle
        self._turn = self._turns(angle)

    def restart(self) -> None:
        """Restart the count as after a power cycle, with no index pulse detected yet."""
        angle = self._angle or 0.0
        self._shift = -angle if self._shift_absolute is None else self._shift_absolute
        self.position, self.velocity = self._quantised(angle), 0.0
        self.index_detected = self.index_toggle = self.stuck = False

    def jump(self, angle: float) -> None:
        """Emulate lost or doubled pulses: add an angle [rad] to the measured angle."""
        self._shift += angle

    def _pass_index(self) -> None:
        self.index_detected = True
        self.index_toggle = not self.index_toggle

    def _turns(self, angle: float) -> int:
        """Return the number of index pulses between `pulse_offset` and a motor angle [rad]."""
        return floor((angle - self._pulse_offset) / (2.0 * pi))

    def _quantised(self, angle: float) -> float:
        return floor((angle + self._shift) * _COUNTS_PER_RAD) * RAD_PER_COUNT


ROOM = 25.0  # [degC]
CRITICAL = 130.0
"""Winding temperature [degC] at which an emulated board reports the temperature error."""
# Temperature at which copper resistance extrapolates to zero [degC] (IEC 60034-1).
_ABSENT = -234.5
# Fraction of the winding's thermal resistance to the housing, and of its heat capacity, that
# belongs to the copper.
_COPPER_RESISTANCE, _COPPER_CAPACITY = 0.12, 0.35
# Iron losses at this speed [rad/s] are this fraction of the continuous copper loss.
_IRON_SPEED, _IRON_SHARE = 150.0, 0.1
# Real motors deviate from nominal data by up to this fraction: thermal resistances, heat
# capacities, and copper resistance.
_SPREAD = 0.1
_COPPER_SPREAD = 0.05
# integration steps in the shortest time constant, for a stable explicit integration
_SHORTEST = 5.0


class EmulatedHeat:
    """Thermal model of a motor: copper, stator iron and housing, in air at 25 degC.

    The model shares no code with the estimator of `hardware.heat_watch`: it has more bodies, iron
    losses, another numerical method (explicit midpoint) and, with a seed, other parameters.

    Parameters
    ----------
    motor
        Nominal motor data of the configuration.
    seed
        Seed of the deviations; None for nominal data.

    Attributes
    ----------
    temperatures
        Temperatures of copper, iron and housing [degC].
    """

    def __init__(self, motor: MotorConfig, seed: int | None = None) -> None:
        self.temperatures = [ROOM, ROOM, ROOM]
        draw = [0.0] * 6
        if seed is not None:
            draw = np.random.default_rng(seed).uniform(-1.0, 1.0, 6).tolist()
        off = [1.0 + _SPREAD * value for value in draw]
        data = motor.thermal_or_guess
        self._cold = motor.resistance * (1.0 + _COPPER_SPREAD * draw[5])
        hottest = data.temperature_max
        hot = motor.resistance * (hottest - _ABSENT) / (ROOM - _ABSENT)
        steady_loss = 1.5 * hot * data.continuous_current**2
        whole = (hottest - ROOM) / steady_loss
        inner, outer = (1.0 - data.housing_share) * whole, data.housing_share * whole
        store = data.winding_time / inner
        self._conductance = (
            1.0 / (off[0] * _COPPER_RESISTANCE * inner),
            1.0 / (off[0] * (1.0 - _COPPER_RESISTANCE) * inner),
            1.0 / (off[1] * outer),
        )
        self._capacity = (
            off[2] * _COPPER_CAPACITY * store,
            off[3] * (1.0 - _COPPER_CAPACITY) * store,
            off[4] * data.housing_time / outer,
        )
        self._iron = _IRON_SHARE * steady_loss / _IRON_SPEED**2
        self._longest = self._capacity[0] / (_SHORTEST * self._conductance[0])

    @classmethod
    def of_joint(cls, joint: JointConfig, arm_seed: int | None) -> EmulatedHeat:
        """Return the thermal model of a joint's motor, with random deviations by the seed."""
        if arm_seed is None:
            return cls(joint.motor)
        return cls(joint.motor, 2 * (1000 * arm_seed + joint.board) + joint.channel)

    @property
    def copper(self) -> float:
        """Present temperature of the copper winding [degC]."""
        return self.temperatures[0]

    @property
    def resistance(self) -> float:
        """Phase resistance [ohm] at the present temperature of the copper winding."""
        return self._cold * (self.temperatures[0] - _ABSENT) / (ROOM - _ABSENT)

    def warm(self, temperature: float) -> None:
        """Set winding, iron and housing of the motor to a temperature [degC]."""
        self.temperatures = [temperature, temperature, temperature]

    def step(self, square: float, speed: float, duration: float) -> None:
        """Advance the temperatures by `duration` [s], given mean squared current and speed."""
        steps = int(duration / self._longest) + 1
        dt = duration / steps
        for _ in range(steps):
            half = self._moved(self._slopes(square, speed), 0.5 * dt)
            before, self.temperatures = self.temperatures, half
            slopes = self._slopes(square, speed)
            self.temperatures = before
            self.temperatures = self._moved(slopes, dt)

    def _moved(self, slopes: tuple[float, float, float], dt: float) -> list[float]:
        return [t + dt * slope for t, slope in zip(self.temperatures, slopes, strict=True)]

    def _slopes(self, square: float, speed: float) -> tuple[float, float, float]:
        copper, iron, housing = self.temperatures
        inside = self._conductance[0] * (copper - iron)
        through = self._conductance[1] * (iron - housing)
        away = self._conductance[2] * (housing - ROOM)
        loss = 1.5 * self.resistance * square
        return (
            (loss - inside) / self._capacity[0],
            (self._iron * speed * speed + inside - through) / self._capacity[1],
            (through - away) / self._capacity[2],
        )


_CURRENT_BANDWIDTH = 2.0 * pi * 1000.0  # [rad/s] bandwidth of the closed current loop
# error of the rotor's travel, in electrical turns, above which the alignment has failed
_TRAVEL_TOLERANCE = 0.3


class EmulatedMotor:
    """Emulated motor with alignment, control law (thesis (4.4)), current loop and encoder.

    The model advances in equal sub-steps. The board writes the references and gains, named as in
    `BoardCommand`, and reads the measurements.

    Attributes
    ----------
    torque_current
        Current that produces torque [A]; the plant multiplies it by the true torque constant.
    delivery
        Fraction of the target current that the driver delivers.
    enabled, ready, alignment_failed
        Whether the board has enabled the motor, whether the motor is aligned, and whether its
        alignment has failed.
    heat
        Thermal model of the motor.
    """

    def __init__(
        self,
        motor: MotorConfig,
        substep: float,
        alignment: AlignmentTiming,
        zero: float | None = 0.0,
        absolute: bool = False,
        pulse_offset: float = 0.0,
    ) -> None:
        self.encoder = EmulatedEncoder(substep, zero, absolute, pulse_offset)
        self.heat = EmulatedHeat(motor)
        self.position = self.velocity = self.current = 0.0
        self.kp = self.kd = self.integral_gain = 0.0
        self.current_saturation = motor.current_max
        self.delivery = 1.0
        self.torque_current = 0.0
        self.target_current = 0.0
        self.ready = False
        self.alignment_failed = False
        self._motor = motor
        self._substep = substep
        self._alignment = alignment
        self._current_gain = 1.0 - exp(-_CURRENT_BANDWIDTH * substep)
        self.enabled = False
        self._aligning_for = 0.0
        self._travel_start = 0.0
        self._integral = 0.0

    @property
    def measured_current(self) -> float:
        """Quadrature current [A] in the rotor frame of the firmware; 0 during alignment."""
        return self.torque_current if self.ready else 0.0

    @property
    def quadrature_voltage(self) -> float:
        """Quadrature voltage [V] that is consistent with the motor power of thesis (4.1)."""
        back_emf = 2.0 / 3.0 * self._motor.torque_constant * self.encoder.velocity
        return self.heat.resistance * self.measured_current + back_emf

    @property
    def power(self) -> float:
        """Electrical power consumption of the motor [W], negative while braking."""
        return 1.5 * self.quadrature_voltage * self.measured_current

    def enable(self, enabled: bool) -> None:
        """Enable or disable the motor; enabling first aligns a motor that is not aligned."""
        if enabled and not self.enabled and not self.ready:
            self._aligning_for = 0.0
        self.enabled = enabled
        self._integral = 0.0 if not enabled else self._integral

    def forget_alignment(self) -> None:
        """Disable the motor, so that it is aligned again when it is enabled."""
        self.enabled = self.ready = self.alignment_failed = False
        self._integral = 0.0

    def step(self, angle: float) -> None:
        """Advance the emulated motor by one sub-step at a true motor angle [rad]."""
        encoder = self.encoder
        encoder.sample(angle)
        if not self.enabled:
            self.target_current = 0.0
        elif self.ready:
            error = self.position - encoder.position
            target = self.kp * error + self.kd * (self.velocity - encoder.velocity) + self.current
            if self.integral_gain:
                target += self._integrate(error)
            limit = self.current_saturation
            self.target_current = -limit if target < -limit else min(target, limit)
        else:
            self._align(angle)
            return
        target = self.delivery * self.target_current
        self.torque_current += self._current_gain * (target - self.torque_current)

    def _integrate(self, error: float) -> float:
        """Return the integral term [A] of control law (4.4), limited to the largest current."""
        limit = self.current_saturation
        step = self.integral_gain * error * self._substep
        self._integral = min(max(self._integral + step, -limit), limit)
        return self._integral

    def _align(self, angle: float) -> None:
        """Advance the alignment by one sub-step, in which a rotating field turns the rotor."""
        timing, before = self._alignment, self._aligning_for
        self._aligning_for = now = before + self._substep
        if now < timing.forward:
            turn = now / timing.forward
        else:
            turn = max(0.0, 1.0 - (now - timing.forward) / timing.reverse)
        pole_pairs = self._motor.pole_pairs
        current = self.delivery * timing.current
        self.torque_current = current * sin(2.0 * pi * turn - pole_pairs * angle)
        self.target_current = timing.current
        if before < timing.forward <= now:
            self._travel_start = self.encoder.position
        if now >= timing.total:
            electrical_turns = (
                (self._travel_start - self.encoder.position) * pole_pairs / (2.0 * pi)
            )
            self.alignment_failed = abs(electrical_turns - 1.0) > _TRAVEL_TOLERANCE
            self.ready = not self.alignment_failed
            self.torque_current = 0.0
