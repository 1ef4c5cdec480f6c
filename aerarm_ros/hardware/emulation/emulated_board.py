"""Emulated motor board that exchanges SPI frames with the bridge and drives two motors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from aerarm_ros.description.drive_config import MotorConfig
from aerarm_ros.hardware.emulation.emulated_motor import (
    CRITICAL,
    AlignmentTiming,
    EmulatedHeat,
    EmulatedMotor,
)
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD, BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import FRAME_BYTES, FrameProfile


@dataclass(slots=True)
class BoardFaults:
    """Faults of an emulated board that last until its power cycle; none by default.

    Attributes
    ----------
    bit_error_rate
        Fraction of frames, in each direction, in which one to three bits flip.
    lost_frame_rate
        Fraction of exchanges that the board misses: it reads no frame, and its answer consists of
        zeros.
    lost_command_rate
        Fraction of commands that do not reach the board although its answers reach the host.
    dead
        The board has no supply: its answers consist of zeros, and its motors give no torque.
    deaf
        The board answers but receives no commands, so its time-out expires.
    mute
        The board receives commands, but its answers consist of zeros.
    answer_bytes
        Number of bytes of an answer that reach the host.
    exchange_time
        Duration of an exchange [s].
    """

    bit_error_rate: float = 0.0
    lost_frame_rate: float = 0.0
    lost_command_rate: float = 0.0
    dead: bool = False
    deaf: bool = False
    mute: bool = False
    answer_bytes: int = FRAME_BYTES
    exchange_time: float = 40e-6


def _of_both(value: float) -> list[float]:
    return [value, value]


@dataclass(slots=True)
class BoardWiring:
    """Wiring and assembly errors of an emulated board and its two motors; none by default.

    A power cycle does not remove these errors. Lists have one entry per channel.

    Attributes
    ----------
    swapped
        Whether each of the two motors, with its encoder, is connected to the channel of the other
        motor.
    direction
        -1 for a motor that turns its joint against the configuration's sign, otherwise 1.
    reduction
        Motor turns per joint turn; 0 for the configured gear ratio.
    delivery
        Delivered current as a fraction of the requested current; the current is measured
        correctly.
    friction
        Factor by which the dry friction of the driven joint is multiplied.
    """

    swapped: bool = False
    direction: list[float] = field(default_factory=lambda: _of_both(1.0))
    reduction: list[float] = field(default_factory=lambda: _of_both(0.0))
    delivery: list[float] = field(default_factory=lambda: _of_both(1.0))
    friction: list[float] = field(default_factory=lambda: _of_both(1.0))


_RESISTANCE = 0.05  # [ohm] resistance of battery and leads
_VOLTAGE = 24.0  # [V]


class EmulatedSupply:
    """Emulated supply of a motor board: a battery, or a supply that cannot absorb current.

    Attributes
    ----------
    source
        Open-circuit voltage [V].
    capacitance
        Capacitance of the board [F] if the supply cannot absorb current; 0 for a battery.
    voltage
        Voltage at the board [V].
    """

    def __init__(self) -> None:
        self.source = self.voltage = _VOLTAGE
        self.capacitance = 0.0

    def step(self, power: float, duration: float) -> None:
        """Update the supply voltage, after the motors drew a power [W] for `duration` [s]."""
        loaded = self.source - _RESISTANCE * power / self.source
        if not self.capacitance or power > 0.0 and self.voltage <= self.source:
            self.voltage = loaded
            return
        # No current flows back, so regenerated energy charges the capacitors, C/2 V^2.
        stored = self.voltage**2 - 2.0 * power * duration / self.capacitance
        self.voltage = max(sqrt(max(stored, 0.0)), min(loaded, self.source))


ENCODER_ERRORS = (1, 6)  # error codes of motor 1 and motor 2
TIMEOUT_ERROR = 2
ROLLOVER_ERROR = 5

_ROLLOVER = 128.0 * 2.0 * np.pi  # [rad] end of the position field's range
_CURRENT_NOISE = 0.02  # [A] standard deviation of the current measurement
_NOISE_LENGTH = 8192
_LINE_LOW = bytes(FRAME_BYTES)
_SLOW_STEPS = 8  # sub-steps between two updates of heat and supply


class EmulatedBoard:
    """Emulated motor board that behaves at its SPI interface like the real firmware.

    The transport advances the motors by `step` together with the plant; frames pass through
    `exchange` at any time in between. An error switches the motors off. With
    `profile.errors_until_power_cycle` only `power_cycle` clears it, otherwise a command with the
    system disabled does.

    Parameters
    ----------
    profile
        Frame layout of the board.
    substep
        Time between two calls of `step` [s].
    seed
        Seed of measurement noise and random faults.
    heats
        Thermal models of the two motors; None for nominal data.
    alignment
        Durations and current of the alignment when a motor is enabled.
    zeros
        True angles [rad] of the two motors at which their encoders count zero; None for the angle
        at power-on.
    absolute
        Whether the encoders of the two motors are absolute.
    pulse_offsets
        True angles [rad] of the two motors at their index pulses, modulo one turn.

    Attributes
    ----------
    wiring
        Wiring errors of the board; `rewire` notifies the transport of a change.
    """

    TEMPERATURE_ERROR, DRIVER_ERROR = 3, 7

    def __init__(
        self,
        profile: FrameProfile,
        motors: Sequence[MotorConfig],
        substep: float,
        *,
        seed: int = 0,
        heats: Sequence[EmulatedHeat | None] = (None, None),
        alignment: AlignmentTiming | None = None,
        zeros: Sequence[float | None] = (0.0, 0.0),
        absolute: Sequence[bool] = (False, False),
        pulse_offsets: Sequence[float] = (0.0, 0.0),
    ) -> None:
        self.faults = BoardFaults()
        self.wiring = BoardWiring()
        self.rewire: Callable[[], None] = lambda: None
        self.supply = EmulatedSupply()
        self.error = 0
        self._codec = FrameCodec(profile)
        self._reports_voltage = profile.sensor.has('quadrature_voltage')
        self._until_power_cycle = profile.errors_until_power_cycle
        self._current_max = tuple(motor.current_max for motor in motors)
        timing = alignment or AlignmentTiming()
        self.motors = tuple(
            EmulatedMotor(motors[i], substep, timing, zeros[i], absolute[i], pulse_offsets[i])
            for i in range(len(motors))
        )
        for emulated, heat in zip(self.motors, heats, strict=True):
            emulated.heat = heat or emulated.heat
        self._squares = [0.0, 0.0]  # sum of squared currents since the last thermal update [A^2]
        self._steps = 0
        self._substep = substep
        self._random = np.random.default_rng(seed)
        noise = _CURRENT_NOISE * self._random.standard_normal(_NOISE_LENGTH)
        self._noise: list[float] = noise.tolist()
        self._noise_index = 0
        self._command = BoardCommand()
        self._state = BoardState()
        self._prepared: bytes | None = None
        self._clock = 0.0
        self._silence = 0.0

    @property
    def system_enabled(self) -> bool:
        """Whether the board is enabled, has supply voltage, and reports no error."""
        return self._command.enable_system and self.error == 0 and not self.faults.dead

    @property
    def is_torque_free(self) -> bool:
        """Whether neither motor of the board produces torque before the next command arrives.

        The motors have no torque if the board is switched off, or if its time-out has expired
        after a command of zero current (which is not an error of the board).
        """
        is_silent = 0.0 < self._command.timeout < self._silence
        return not self.system_enabled or (is_silent and not self._is_driving())

    def exchange(self, frame: bytes) -> bytes:
        """Process a command frame; return the sensor frame that `prepare` has prepared."""
        faults = self.faults
        if faults.dead or (faults.lost_frame_rate and self._happens(faults.lost_frame_rate)):
            return _LINE_LOW
        answer = self._prepared or self._sensor_frame()
        self._prepared = None
        is_lost = faults.lost_command_rate and self._happens(faults.lost_command_rate)
        if not (faults.deaf or is_lost):
            self._receive(self._with_bit_errors(frame))
        if faults.mute:
            return _LINE_LOW
        return self._with_bit_errors(answer)[: faults.answer_bytes]

    def prepare(self) -> None:
        """Prepare the sensor frame for the next exchange, as the firmware does in its loop."""
        self._prepared = self._sensor_frame()

    def step(self, angle_1: float, angle_2: float) -> None:
        """Advance the emulated board by one sub-step at the true angles of its motors [rad]."""
        first, second = self.motors
        first.step(angle_1)
        second.step(angle_2)
        self._clock += self._substep
        self._silence += self._substep
        squares = self._squares
        squares[0] += first.torque_current * first.torque_current
        squares[1] += second.torque_current * second.torque_current
        self._steps += 1
        if self._steps == _SLOW_STEPS:
            self._warm()
        self._check()

    def _warm(self) -> None:
        """Advance motor temperatures and supply voltage by the sub-steps since the last call."""
        duration = self._steps * self._substep
        power = 0.0
        for i, motor in enumerate(self.motors):
            motor.heat.step(self._squares[i] / self._steps, motor.encoder.velocity, duration)
            self._squares[i] = 0.0
            power += motor.power
            if motor.heat.copper > CRITICAL:
                self.raise_error(self.TEMPERATURE_ERROR)
        self.supply.step(power, duration)
        self._steps = 0

    def raise_error(self, code: int) -> None:
        """Switch the motors off with an error code; keep the code of an earlier error."""
        self._prepared = None
        if self.error == 0:
            self.error = code
        for motor in self.motors:
            motor.forget_alignment()

    def power_cycle(self) -> None:
        """Switch the supply off and on, which clears errors, faults, counts and commands."""
        self.faults = BoardFaults()
        self.error = 0
        self._prepared = None
        self._command = BoardCommand()
        self._state.index = 0
        self._clock = self._silence = 0.0
        for motor in self.motors:
            motor.encoder.restart()
            motor.forget_alignment()

    def cut_power(self) -> None:
        """Switch the board's supply off until `power_cycle` is called."""
        self.faults.dead = True
        for motor in self.motors:
            motor.forget_alignment()

    def _receive(self, frame: bytes) -> None:
        command = self._codec.decode_command(frame, self._command)
        if command is None:
            return  # the firmware ignores the frame and keeps the previous command
        self._silence = 0.0
        self._state.index = command.index
        if not command.enable_system:
            if not self._until_power_cycle:
                self.error = 0
            for motor in self.motors:
                motor.forget_alignment()
            return
        for i, motor in enumerate(self.motors):
            motor.position = command.position[i]
            motor.velocity = command.velocity[i]
            motor.current = command.current[i]
            motor.kp = command.kp[i]
            motor.kd = command.kd[i]
            motor.integral_gain = command.integral_gain[i]
            motor.current_saturation = min(
                command.current_saturation[i] or self._current_max[i], self._current_max[i]
            )
            if self.error == 0 and command.enable_motor[i] != motor.enabled:
                motor.enable(command.enable_motor[i])

    def _check(self) -> None:
        """Report the errors that the real firmware detects in every control loop."""
        command = self._command
        if command.timeout and self._silence > command.timeout and self._is_driving():
            self.raise_error(TIMEOUT_ERROR)
        for i, motor in enumerate(self.motors):
            if motor.alignment_failed:
                self.raise_error(ENCODER_ERRORS[i])
            if abs(motor.encoder.position) > _ROLLOVER and command.position_rollover_error:
                self.raise_error(ROLLOVER_ERROR)

    def _is_driving(self) -> bool:
        return any(motor.enabled and motor.target_current != 0.0 for motor in self.motors)

    def _sensor_frame(self) -> bytes:
        state = self._state
        state.system_enabled = self.system_enabled
        state.error = self.error
        state.timestamp = self._clock % TIMESTAMP_PERIOD
        for i, motor in enumerate(self.motors):
            encoder = motor.encoder
            state.motor_enabled[i] = motor.enabled
            state.motor_ready[i] = motor.ready
            state.index_detected[i] = encoder.index_detected
            state.index_toggle[i] = encoder.index_toggle
            state.position[i] = encoder.position
            state.velocity[i] = encoder.velocity
            state.current[i] = motor.measured_current + self._noise[self._noise_index]
            state.coil_resistance[i] = motor.heat.resistance
            if self._reports_voltage:
                state.quadrature_voltage[i] = motor.quadrature_voltage
                state.bus_voltage[i] = self.supply.voltage
            self._noise_index = (self._noise_index + 1) % _NOISE_LENGTH
        return self._codec.encode_state(state)

    def _with_bit_errors(self, frame: bytes) -> bytes:
        if not self.faults.bit_error_rate or not self._happens(self.faults.bit_error_rate):
            return frame
        damaged = bytearray(frame)
        bits = self._random.choice(8 * len(frame), self._random.integers(1, 4), replace=False)
        for bit in bits.tolist():
            damaged[bit // 8] ^= 1 << bit % 8
        return bytes(damaged)

    def _happens(self, rate: float) -> bool:
        return bool(self._random.random() < rate)
