"""An emulated dual-motor board: frames in, frames out, motors in between."""

from collections.abc import Callable, Sequence

import numpy as np

from aerarm_ros.description.motor_config import MotorConfig
from aerarm_ros.hardware.emulation.alignment_timing import AlignmentTiming
from aerarm_ros.hardware.emulation.board_faults import BoardFaults
from aerarm_ros.hardware.emulation.board_wiring import BoardWiring
from aerarm_ros.hardware.emulation.emulated_heat import CRITICAL, EmulatedHeat
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedMotor
from aerarm_ros.hardware.emulation.emulated_supply import EmulatedSupply
from aerarm_ros.hardware.frames.board_command import BoardCommand
from aerarm_ros.hardware.frames.board_state import TIMESTAMP_PERIOD, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import FRAME_BYTES, FrameProfile

ENCODER_ERRORS = (1, 6)  # of motor 1, motor 2
TIMEOUT_ERROR = 2
TEMPERATURE_ERROR = 3
ROLLOVER_ERROR = 5
DRIVER_ERROR = 7

_ROLLOVER = 128.0 * 2.0 * np.pi  # [rad] end of the position field
_CURRENT_NOISE = 0.02  # [A] standard deviation
_NOISE_LENGTH = 8192
_LINE_LOW = bytes(FRAME_BYTES)
_SLOW_STEPS = 8  # sub-steps between two looks at heat and supply


class EmulatedBoard:
    """Behaves on the wire as the profile's firmware does, as far as the master can tell.

    Motors are advanced by `step`, which the transport calls in step with the plant; frames
    pass through `exchange` at any time between. An error switches the motors off. With
    `profile.errors_until_power_cycle` only `power_cycle` removes it, else a command with
    the system disabled does.

    Parameters
    ----------
    profile
        Frames of the board.
    motors
        The two motors.
    substep
        Time between two calls of `step` [s].
    seed
        Of measurement noise and of random faults.
    heats
        How warm the two motors get; None for motors as stated.
    alignment
        What happens when a motor is enabled.
    zeros
        True angles [rad] of the two motors at which their encoders count zero; None where they
        are switched on.
    absolute
        Whether the encoders of the two motors are absolute.
    pulse_offsets
        True angles [rad] of the two motors at an index pulse, modulo one turn.

    Attributes
    ----------
    wiring
        What is connected to the board; `rewire` tells whoever connects that it has changed.
    """

    def __init__(
        self,
        profile: FrameProfile,
        motors: Sequence[MotorConfig],
        substep: float,
        *,
        seed: int = 0,
        heats: Sequence[EmulatedHeat] | None = None,
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
        for emulated, heat in zip(self.motors, heats or (), strict=False):
            emulated.heat = heat
        self._squares = [0.0, 0.0]  # of the currents, since the last look at the heat [A^2]
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
        """Whether the board drives motors at all."""
        return self._command.enable_system and self.error == 0 and not self.faults.dead

    @property
    def has_let_go(self) -> bool:
        """Whether no motor has torque until a command comes.

        It is switched off, or its time-out has passed on a command of no current, which is no
        error.
        """
        is_silent = 0.0 < self._command.timeout < self._silence
        return not self.system_enabled or (is_silent and not self._is_driving())

    def exchange(self, frame: bytes) -> bytes:
        """Take a command frame and return the sensor frame that was ready before it."""
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
        """Make the frame of the next exchange, as the firmware does after its last loop."""
        self._prepared = self._sensor_frame()

    def step(self, angle_1: float, angle_2: float) -> None:
        """Advance by one sub-step at the true motor angles [rad]."""
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
        """Let heat and supply follow the sub-steps since the last time."""
        duration = self._steps * self._substep
        power = 0.0
        for i, motor in enumerate(self.motors):
            motor.heat.step(self._squares[i] / self._steps, motor.encoder.velocity, duration)
            self._squares[i] = 0.0
            power += motor.power
            if motor.heat.copper > CRITICAL:
                self.raise_error(TEMPERATURE_ERROR)
        self.supply.step(power, duration)
        self._steps = 0

    def raise_error(self, code: int) -> None:
        """Stop with an error code; the first one stays."""
        self._prepared = None
        if self.error == 0:
            self.error = code
        for motor in self.motors:
            motor.forget_alignment()

    def power_cycle(self) -> None:
        """Switch the supply off and on: errors, faults, alignment, counts, commands are gone."""
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
        """Take the supply away until `power_cycle`."""
        self.faults.dead = True
        for motor in self.motors:
            motor.forget_alignment()

    def _receive(self, frame: bytes) -> None:
        command = self._codec.decode_command(frame, self._command)
        if command is None:
            return  # the firmware ignores it and goes on with the command before
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
            motor.compensate_index = command.index_offset_compensation[i]
            if self.error == 0 and command.enable_motor[i] != motor.enabled:
                motor.enable(command.enable_motor[i])

    def _check(self) -> None:
        """Raise the errors that the firmware looks for in every loop."""
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
