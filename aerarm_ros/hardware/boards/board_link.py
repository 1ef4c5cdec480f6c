"""Exchange of SPI frames with a motor board, and the last state that the board reported."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan
from typing import Protocol

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain
from aerarm_ros.hardware.boards.board_monitor import BoardMonitor
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD, BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec, FrameError
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import Mask
from aerarm_ros.motion.signals import Array

# A board that did not restart has a clock that is at most this far ahead of the host clock, or
# jumps back by at most this between two answers [s], ...
_TICKS = 0.05
_DRIFT = 0.01  # ... relative to the time between the answers


class RestartWatch:
    """Detects a restart of a motor board from the board's answers.

    A board may restart between two answers or while it does not answer; its encoders then count
    from zero again. Three signs reveal a restart: an unexpected board time, a missing index pulse
    flag, or the disappearance of an error that lasts until power-off.

    Parameters
    ----------
    until_power_cycle
        Whether the board keeps an error until its supply has been off.
    """

    def __init__(self, until_power_cycle: bool) -> None:
        self._until_power_cycle = until_power_cycle
        self._timestamp: float | None = None
        self._error = 0
        self._detected = (False, False)

    def saw(self, state: BoardState, longest: float) -> bool:
        """Process an answer of the board; return whether it shows that the board restarted.

        Parameters
        ----------
        state
            State that the board reports.
        longest
            Longest possible time between the previous answer and this one [s].
        """
        first, second = detected = state.index_detected[0], state.index_detected[1]
        restarted = False
        if self._timestamp is not None:
            ahead = (state.timestamp - self._timestamp) % TIMESTAMP_PERIOD
            # The clock of a board that was without power lags behind the host clock, but is never
            # ahead.
            most = (1.0 + _DRIFT) * (longest if longest > 0.0 else 0.0) + _TICKS
            had_first, had_second = self._detected
            restarted = (
                most < ahead < TIMESTAMP_PERIOD - _TICKS
                # After a silence of 65.5 s or more, the period of the clock, the clock gives no
                # information.
                or most >= TIMESTAMP_PERIOD
                or (had_first and not first)
                or (had_second and not second)
                or (self._until_power_cycle and self._error != 0 and not state.error)
            )
        self._timestamp, self._error, self._detected = state.timestamp, state.error, detected
        return restarted


_BOARD_INTERVAL_MAX = 1.0  # [s]
_SATURATION_MIN = 0.5  # [A]


class Transport(Protocol):
    """Interface of a full-duplex exchange of SPI frames with the motor boards.

    Once open, `exchange` never raises and takes a bounded time. An unreachable board returns no
    bytes, and `problem` gives the reason.
    """

    def open(self) -> None:
        """Open the SPI bus; if that fails, raise TransportError with advice on what to check."""

    def close(self) -> None:
        """Close the SPI bus; do nothing if it is closed already."""

    def advance(self, now: float) -> None:
        """Simulate emulated boards up to the time `now` [s, monotonic]; real boards ignore it."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Send a frame to a board; return the frame that the board sends back, b'' if none."""

    def exchange_time(self, board: int) -> float:
        """Duration of the last frame exchange with a board [s]."""

    def exchanged_at(self, board: int) -> float:
        """End time [s] of the last frame exchange with a board, on the clock of `advance`.

        A board prepares its answer at most one period of its control loop before the exchange
        begins; the exchange begins `exchange_time` before its end.
        """

    def problem(self, board: int) -> str:
        """Reason why the last frame exchange with a board failed; '' after a success."""

    def self_test(self, profile: FrameProfile) -> Sequence[Answer]:
        """Test the open connection to each board while its motors are off; return the results."""


class BoardLink:
    """Exchanges one frame per bridge cycle with a motor board.

    Parameters
    ----------
    number, name
        Number of the board in the transport, and its name in messages.
    joints
        Joint number and channel (0 or 1) of each motor in use.
    current_saturation
        Largest currents [A] of channels 0 and 1; 0 for an unused channel.
    profile, settings, transport
        Frame layout, tolerances, and connection to the board.

    Raises
    ------
    ValueError
        If no frame can represent the time-out or a current limit of the settings.

    Attributes
    ----------
    monitor
        State machine of the board, with counts of bad frames.
    state
        State in the last valid answer of the board.
    fresh
        Whether the last exchange brought a valid answer.
    is_aligned
        Whether every motor in use was driven and aligned at the board's last answer.
    restarted
        Whether the last answer shows that the board restarted since the previous answer.
    keeps_errors
        Whether the board keeps an error until its supply has been off.
    interval
        Time between the last two valid answers [s]; inf before the second.
    interval_max
        Upper bound of `interval` [s], including delays of the host between reading the clock and
        exchanging a frame.
    """

    def __init__(
        self,
        number: int,
        name: str,
        joints: Sequence[tuple[int, int]],
        current_saturation: Sequence[float],
        profile: FrameProfile,
        settings: BridgeSettings,
        transport: Transport,
    ) -> None:
        self.joints = tuple(joints)
        self.monitor = BoardMonitor(name, profile, [channel for _, channel in joints], settings)
        self.state = BoardState()
        self.fresh = self.restarted = self.is_aligned = False
        self.keeps_errors = profile.errors_until_power_cycle
        self._restart_watch = RestartWatch(self.keeps_errors)
        self.interval = self.interval_max = inf
        # earliest and latest time of the last valid answer [s]
        self._earliest = self._latest = -inf
        self._sent = -inf  # time at which the last frame was sent to the board [s]
        self._lapsed = False
        self._number = number
        self._transport = transport
        self._codec = FrameCodec(profile)
        used = {channel for _, channel in joints}
        self._used = [channel in used for channel in (0, 1)]
        # An unused channel is never enabled, but its current limit must not be 0.
        self._saturation = [value or 1.0 for value in current_saturation]
        self._command = BoardCommand(
            timeout=settings.board_timeout, current_saturation=self._saturation.copy()
        )
        # Values that no frame can represent are detected now, and not when the board has to be
        # switched off.
        try:
            self._codec.encode(self._switched_off())
        except FrameError as error:
            raise ValueError(f'the limits cannot be sent to {name}: {error}') from None

    @property
    def answered_at(self) -> float:
        """Time of the board's last valid answer [s], -inf before the first answer."""
        return self._latest

    @property
    def may_be_damped(self) -> bool:
        """Whether the board may continue to damp its joints after a fault has stopped the arm.

        A board that restarted must be switched off, because it must not align without a request.
        A board that does not answer may stay on: on a half-broken wire it may still receive
        commands, and switching it off would drop its joints. A board that receives no frame
        switches itself off after its time-out.
        """
        return self.is_aligned and not self.state.error and not self._lapsed

    @property
    def is_damped_without_answer(self) -> bool:
        """Whether the bridge sends damping commands although the board sends no valid answers."""
        return self._command.enable_system and self.monitor.is_silent

    def drive_only(self, channel: int | None) -> None:
        """Let `exchange` drive the motor of one channel only; None lets it drive all motors."""
        channels = [used for _, used in self.joints] if channel is None else [channel]
        self._used = [number in channels for number in (0, 1)]
        self.monitor.watch(channels)
        self.is_aligned = self.monitor.is_aligned(self.state)

    def exchange(self, references: MotorReferences, enable: bool, running: bool) -> None:
        """Send the board the references of its motors, and store the measurements that it returns.

        If `enable` is False, the board is commanded to switch its motors off. If no frame can
        represent the references, that is a fault, and the board's motors get no current in this
        cycle.
        """
        command = self._command
        command.index = (command.index + 1) & 0xFFFF
        command.enable_system = enable
        command.enable_motor = self._used if enable else [False, False]
        self._write(references)
        try:
            frame = self._codec.encode(command)
        except FrameError as error:
            self.monitor.fail(str(error))
            for joint, _ in self.joints:
                references.motors[joint].release()
            self._write(references)
            frame = self._codec.encode(command)
        answer = self._transport.exchange(self._number, frame)
        self._receive(answer, enable, running)
        self.monitor.sent(command.index)

    def _write(self, references: MotorReferences) -> None:
        command = self._command
        for joint, channel in self.joints:
            motor = references.motors[joint]
            command.position[channel] = motor.position
            command.velocity[channel] = motor.velocity
            command.current[channel] = motor.current
            command.kp[channel] = motor.kp
            command.kd[channel] = motor.kd
            command.integral_gain[channel] = motor.integral_gain
            saturation = self._saturation[channel]
            if motor.current_max < saturation:
                # Below this minimum the field is too coarse, and 0 would mean no limit.
                saturation = min(saturation, max(motor.current_max, _SATURATION_MIN))
            command.current_saturation[channel] = saturation

    def switch_off(self) -> None:
        """Send the board one frame that switches its motors off."""
        self._command.index = (self._command.index + 1) & 0xFFFF
        self._transport.exchange(self._number, self._codec.encode(self._switched_off()))

    def _receive(self, answer: bytes, enable: bool, running: bool) -> None:
        transport, number, state, monitor = self._transport, self._number, self.state, self.monitor
        duration = transport.exchange_time(number)
        ended = transport.exchanged_at(number)
        problem = transport.problem(number)
        monitor.slow(duration)
        timestamp = state.timestamp
        self.fresh = self._codec.decode(answer, state) is not None
        self.restarted = self.fresh and self._restart_watch.saw(state, ended - self._earliest)
        alone = ended - self._sent
        if not problem:
            self._sent = ended
        if self.fresh:
            self._lapsed = False
            self._time(ended - duration, ended, state.timestamp - timestamp)
            self.is_aligned = monitor.received(state, ended, enable, running)
        else:
            self._lapsed = self._lapsed or alone > self._command.timeout
            monitor.missed(enable, problem)

    def _time(self, earliest: float, latest: float, board_interval: float) -> None:
        """Store the bounds of an answer's time [s], and its interval on the board's clock [s]."""
        self.interval = latest - self._latest
        # The board's clock is independent of delays of the host, and includes the age of the data.
        by_board = board_interval % TIMESTAMP_PERIOD
        if by_board > _BOARD_INTERVAL_MAX:  # the board restarted, or its clock went back by a tick
            by_board = 0.0
        by_host = latest - self._earliest
        self.interval_max = by_host if by_host > by_board else by_board
        self._earliest, self._latest = earliest, latest

    def _switched_off(self) -> BoardCommand:
        return BoardCommand(
            timeout=self._command.timeout,
            current_saturation=self._command.current_saturation,
            index=self._command.index,
        )


def make_links(
    config: ArmConfig, profile: FrameProfile, settings: BridgeSettings, transport: Transport
) -> tuple[BoardLink, ...]:
    """Return one `BoardLink` per board, with the joints and current limits of its motors."""
    links = []
    for number, board in enumerate(config.boards):
        saturation = [0.0, 0.0]
        joints = []
        for index, joint in enumerate(config.joints):
            if joint.board == number:
                joints.append((index, joint.channel))
                by_effort = joint.effort_max / joint.torque_per_ampere
                saturation[joint.channel] = min(by_effort, joint.motor.current_max)
        links.append(
            BoardLink(number, board.name, joints, saturation, profile, settings, transport)
        )
    return tuple(links)


class MotorPower:
    """Electrical input power and energy of each motor, thesis (4.1) with i_d = 0.

    If the boards report the quadrature voltage u_q, ``P = 3/2 u_q i_q``. Without u_q, the power is
    the sum of Joule loss and mechanical power for constant current (thesis section 4.1), ``P = 3/2
    R i_q^2 + K_i i_q omega_m``, with the configured R and K_i.

    Parameters
    ----------
    config
        Resistances and torque constants.
    profile
        Frame layout, which determines the quantities that the boards report.

    Attributes
    ----------
    source
        'voltage' (reported) or 'model' (computed).
    watts, energy
        (n,) power [W] and energy since start [J]; updated in place.
    """

    def __init__(self, config: ArmConfig, profile: FrameProfile) -> None:
        self.source = 'voltage' if profile.sensor.has('quadrature_voltage') else 'model'
        self.watts = np.zeros(config.n)
        self.energy = np.zeros(config.n)
        self._joules = [0.0] * config.n
        # stays True, because the last valid state of each board remains available
        self._is_known = False
        resistance = 1.5 * config.column('motor.resistance')
        torque_constant = config.column('motor.torque_constant')
        self._constants: list[list[float]] = np.stack([resistance, torque_constant], 1).tolist()

    def update(self, current: Array, velocity: Array, voltage: Array, dt: float) -> None:
        """Compute the motor powers (n,) and add their energy over the time `dt` [s].

        Power and energy stay zero while an input is NaN because the boards have not answered yet.
        """
        if not self._is_known:
            if np.isnan(current).any():
                return
            self._is_known = True
        is_reported = self.source == 'voltage'
        currents, speeds, voltages = current.tolist(), velocity.tolist(), voltage.tolist()
        for i, (resistance, torque_constant) in enumerate(self._constants):
            amps = currents[i]
            per_ampere = (
                1.5 * voltages[i]
                if is_reported
                else resistance * amps + torque_constant * speeds[i]
            )
            self._joules[i] += per_ampere * amps * dt
            self.watts[i], self.energy[i] = per_ampere * amps, self._joules[i]


def resistance_by_boards(links: Sequence[BoardLink], n: int) -> Array:
    """Return the phase resistances (n,) [ohm] that the boards report for the n motors.

    NaN where the frames carry no resistance or the board reports zero (unknown).
    """
    resistance = np.full(n, np.nan)
    for link in links:
        for joint, channel in link.joints:
            resistance[joint] = link.state.coil_resistance[channel] or np.nan
    return resistance


# The torque correction is valid for reference hold times in this range [s].
_HOLD_MIN, _HOLD_MAX = 1e-5, 5e-3

Gains = Sequence[tuple[float, float]]


class ArmMeasurements:
    """Last valid measurements of the arm's n joints and their motors.

    Attributes
    ----------
    q, dq, tau
        (n,) joint positions [rad], velocities [rad/s], and mean torques of the last cycle [Nm];
        NaN until the first valid answer.
    motor_position, motor_velocity, motor_current, motor_voltage
        (n,) motor positions relative to motor zero [rad], velocities [rad/s], quadrature currents
        [A] and quadrature voltages [V].
    reported_position
        (n,) motor positions as counted by the boards [rad].
    index_toggle
        (n,) bits that flip at an encoder's index pulse.
    fresh
        n flags, whether the motor's board answered in the last cycle.
    has_answered
        n flags, False once the motor's board has been silent for so long that it counts as not
        answering.
    driven
        n flags, whether the motor was aligned and driven when its board last answered.
    unconfirmed
        n numbers of commands sent after the command that the motor's board had used at its last
        answer; 0 while the board loses no command.
    interval, interval_max
        n times between the last two measurements of each motor, and their upper bounds [s]; see
        `BoardLink`.
    """

    def __init__(self, config: ArmConfig) -> None:
        def unknown() -> Array:
            return np.full(config.n, np.nan)

        self.q, self.dq, self.tau = unknown(), unknown(), unknown()
        self.motor_position, self.motor_velocity = unknown(), unknown()
        self.motor_current, self.motor_voltage = unknown(), unknown()
        self.reported_position = unknown()
        self.index_toggle: Mask = np.zeros(config.n, dtype=bool)
        # Lists where each element is read on its own: faster than arrays for four joints.
        self.fresh, self.has_answered, self.driven = ([False] * config.n for _ in range(3))
        self.unconfirmed = [0] * config.n
        self.interval, self.interval_max = [nan] * config.n, [nan] * config.n
        # start of the cycle of the last measurement [s]
        self._measured_at = [-inf] * config.n
        drive, ones, zeros = DriveTrain(config), np.ones(config.n), np.zeros(config.n)
        # Joint angle per motor angle, joint angle at motor angle zero, and torque per current.
        columns = (
            drive.motor_to_joint_velocity(ones),
            drive.motor_to_joint_position(zeros),
            drive.current_to_effort(ones),
        )
        self._drives: list[list[float]] = np.transpose(columns).tolist()
        self._joints = range(config.n)
        self._reliable = unknown()

    def reliable_motion(self, is_reliable: Sequence[bool]) -> tuple[Array, Array]:
        """Return positions [rad] and velocities [rad/s], (n,) each, from reliable readings.

        A joint whose encoder is unreliable (its flag of the n flags `is_reliable` is False) keeps
        its last reliable values, because wrong positions would falsify the computed loads of the
        other joints.
        """
        if False not in is_reliable:
            self._reliable[:] = self.q
            return self.q, self.dq
        np.copyto(self._reliable, self.q, where=is_reliable)
        return self._reliable, np.where(is_reliable, self.dq, 0.0)

    def read(
        self, links: Sequence[BoardLink], zero: Array, gains: Gains, lag: float | None = None
    ) -> None:
        """Compute joint positions, velocities and torques from the boards' last valid answers.

        A board keeps its references for one cycle while the motor turns. The motor current
        therefore falls by Kp times the change of the angle and Kd times the change of the
        velocity (4.4), and the frame contains the current at the end of the cycle. The mean
        current of the cycle is computed from it. Without this correction every moving joint would
        appear to have negative viscous friction and too little inertia.

        Parameters
        ----------
        zero
            (n,) reported angles of motor zero [rad].
        gains
            Kp and Kd of each board's motors, n pairs, motor side [A/rad], [A s/rad].
        lag
            Time constant of the boards' current loop [s]; None when the same states are read
            again.
        """
        last_velocities = self.motor_velocity.tolist()
        for link in links:
            state, echo, is_fresh = link.state, link.monitor.echo, link.fresh
            unconfirmed = echo.unconfirmed if echo.is_losing else 0
            has_answered, is_driven = not link.monitor.is_silent, link.is_aligned
            for joint, channel in link.joints:
                self.fresh[joint] = is_fresh
                self.has_answered[joint] = has_answered
                self.driven[joint] = is_driven
                self.unconfirmed[joint] = unconfirmed
                if is_fresh:
                    self.reported_position[joint] = state.position[channel]
                    self.motor_velocity[joint] = state.velocity[channel]
                    self.motor_current[joint] = state.current[channel]
                    self.motor_voltage[joint] = state.quadrature_voltage[channel]
                    self.index_toggle[joint] = state.index_toggle[channel]
                    self.interval[joint] = link.interval
                    self.interval_max[joint] = link.interval_max
        for joint, (
            ratio,
            offset,
            torque_constant,
        ), droop, reported, at_zero, velocity, current in zip(
            self._joints,
            self._drives,
            self._droop(gains, lag, last_velocities),
            self.reported_position.tolist(),
            zero.tolist(),
            self.motor_velocity.tolist(),
            self.motor_current.tolist(),
            strict=True,
        ):
            position = reported - at_zero
            self.motor_position[joint] = position
            self.q[joint] = ratio * position + offset
            self.dq[joint] = ratio * velocity
            self.tau[joint] = torque_constant * (current + droop)

    def age(self, now: float, last: float) -> tuple[list[float], list[float]]:
        """Return the age of each joint's measurement, and the time between its last two [s].

        Call this method once per cycle. `now` is the start of this cycle [s], and `last` the
        start of the cycle whose frames `read` has processed [s]. The time between measurements is
        0 if none has arrived since the last call, and inf if there was no earlier measurement.
        """
        measured_at = self._measured_at
        between = [0.0] * len(measured_at)
        for joint, is_fresh in enumerate(self.fresh):
            if is_fresh:
                between[joint] = last - measured_at[joint]
                measured_at[joint] = last
        # not negative, because the clock may go back
        return [now - time if now > time else 0.0 for time in measured_at], between

    def _droop(self, gains: Gains, lag: float | None, before: Sequence[float]) -> list[float]:
        """Return, per motor, the mean current of the cycle minus the sampled current [A].

        Plain floats are used, because they are faster than arrays for four joints.
        """
        if lag is None:
            return [0.0] * len(gains)
        droop = []
        for (kp, kd), velocity, last, interval in zip(
            gains, self.motor_velocity.tolist(), before, self.interval, strict=True
        ):
            # The current equals its mean in the middle of the cycle. The lag of the current loop
            # covers part of the time from there to the sample.
            longer = _HOLD_MIN if interval < _HOLD_MIN else interval
            hold = _HOLD_MAX if longer > _HOLD_MAX else longer
            share = 0.5 * hold - lag
            share = 0.0 if share < 0.0 else share
            # the first frame has no previous velocity
            change = velocity - last if last == last else 0.0
            droop.append(share * (kp * velocity + kd / hold * change))
        return droop
