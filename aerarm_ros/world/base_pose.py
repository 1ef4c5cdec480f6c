"""Estimation of the base's present pose in the world, from delayed odometry and the IMU."""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.base.base_motion import ImuSample, Mount, rotation_matrix
from aerarm_ros.control.checks import RejectedInputError, positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.flight_estimator import FreezeWatch
from aerarm_ros.flight.flight_state import OdometrySample
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array, limited

_GRAVITY = np.array([0.0, 0.0, -9.81])
# Variances per second of the prediction's error: of the velocity [m^2/s^3], with and without IMU,
# and of the accelerometer's bias [m^2/s^5].
_DRIVE, _DRIVE_BLIND, _BIAS_DRIVE = 2e-3, 0.5, 1e-3
_FIRST = np.diag([1e-4, 1e-2, 4e-2])  # initial variances: position, velocity, bias
_BIAS_MAX = 0.8  # [m/s^2]
# Noise of the odometry: position [m], velocity [m/s], as initial and smallest value; it is
# measured over a number of samples.
_NOISE = np.array([3e-3, 1e-2])
_NOISE_MIN = np.array([3e-4, 1e-3])
_NOISE_SAMPLES = 50.0
_OUTLIER = 4.0  # largest squared error of one sample, in multiples of the variance
_RATE_BIAS_MAX = 0.1  # [rad/s]
# [rad] Attitude errors that count fully for the bias, and above which they count as a step.
_RATE_BIAS_TURN, _RATE_BIAS_STEP = 0.03, 0.1
_NOISE_SHARE = 2.0  # standard deviations of the odometry that the correction takes at any speed
# [m] Largest distance of the tool from the base, for the speed of attitude corrections.
_LEVER = 0.8
_ATTITUDE_TIME = 0.5  # [s] in which the odometry's attitude corrects the gyroscope's drift
_HISTORY = 200  # number of predicted poses: 0.8 s at 250 Hz
_IMU_GAP = 0.05  # [s] without an IMU sample, after which the base is extrapolated
_LONGEST_STEP = 0.02  # [s] of an undivided prediction step
# Difference from the prediction above which a sample counts as a jump: [m], [rad]; and standard
# deviations.
_JUMP, _TURN, _DEVIATIONS = 0.02, 0.15, 5.0
_DOUBT = 0.1  # [s] for which a jump must stay before it is accepted
_GROWTH = 0.3  # [m/s] growth of the prediction's error without odometry
# [s] plausible ages of an IMU sample beyond its latency: a clock offset has more than the first and
# ends below the second. Time over which the smallest age counts, and a step of the clock.
_SAME_CLOCK, _SAME_AGAIN, _CLOCK_TIME, _CLOCK_STEP = 0.05, 0.03, 2.0, 1.0
_OFFSET_STEP, _OFFSET_RATE = 0.08, 0.01  # [s], [s/s]; a smaller change of the offset is slow
_LATE = 0.1  # [s] mean age of the odometry, for a warning
_AGE_TIME = 1.0  # [s] over which the age is averaged
_FROZEN, _MOVING_RATE, _MOVING_SPEED = 0.1, 0.02, 0.02  # [s], [rad/s], [m/s]
_FORGOTTEN = 1.0  # [s] without odometry, after which the next sample is accepted without comparison
_READY = 0.2  # [s] of good samples before the pose is used


class BasePose(NamedTuple):
    """Pose and motion of the arm's base frame.

    Attributes
    ----------
    position, velocity : (3,) ndarray
        Position [m] and velocity [m/s] of the base frame's origin in the world.
    rotation : (3, 3) ndarray
        Base to world.
    rate : (3,) ndarray
        Angular velocity, in base axes [rad/s].
    """

    position: Array
    velocity: Array
    rotation: Array
    rate: Array

    def to_world(self, place: Array) -> Array:
        """Convert a point (3,) [m] from the base frame to the world frame."""
        moved: Array = self.position + self.rotation @ place
        return moved

    def to_base(self, place: Array) -> Array:
        """Convert a point (3,) [m] from the world frame to the base frame."""
        moved: Array = self.rotation.T @ (place - self.position)
        return moved


@dataclass(frozen=True, eq=False)
class OdometryFrames:
    """Poses of base and IMU in the odometry's body frame.

    Attributes
    ----------
    base_position, imu_position : (3,) ndarray
        Positions of the base frame and of the IMU in that frame [m].
    base_rotation, imu_rotation : (3, 3) ndarray
        Rotation from the base frame, or from the IMU's frame, to that frame.
    """

    base_position: Array
    base_rotation: Array
    imu_position: Array
    imu_rotation: Array

    @classmethod
    def of(cls, drone: DroneConfig | None, mount: Mount) -> 'OdometryFrames':
        """Return the poses in the drone's body, or in the base if odometry measures the base."""
        if drone is None:
            return cls(
                np.zeros(3), np.eye(3), mount.imu_position_in_base, mount.rotation_imu_to_base
            )
        base, imu = drone.mount, drone.imu
        return cls(np.array(base.position), base.rotation, np.array(imu.position), imu.rotation)


class _Predicted(NamedTuple):
    """State of the IMU at a time, given on the drone's clock."""

    time: float
    position: Array
    velocity: Array
    rotation: Array  # body to world


class BasePoseEstimator:
    """Filter that predicts the base's pose with the IMU, and corrects it with the odometry.

    A Kalman filter estimates position and velocity of the IMU, and the accelerometer's bias. The
    prediction of the IMU's own position does not need the angular acceleration. The gyroscope
    rotates the attitude, which the odometry corrects within 0.5 s. These corrections also give the
    gyroscope's bias, with a time constant of 1 s. Each odometry sample is compared with the
    prediction for its stamp, and the correction applies to all later times. So an old sample is as
    accurate as a new one, apart from the IMU's error. The scatter of the differences gives the
    noise of the odometry.

    Without IMU samples the pose is extrapolated with the odometry's velocities.

    No correction moves the tool faster than `recovery_speed`, so a jump that is too small to be
    detected moves the tool slowly.

    The estimator measures ages by the drone's clock, which stamps odometry and IMU. The arm's clock
    may differ: if even the fastest IMU samples of 2 s arrive more than 0.05 s later than
    `imu_latency`, or before their stamp, their arrival times give the offset between the clocks.

    Parameters
    ----------
    timeout : float
        Largest age [s] of the newest valid odometry at which the pose is still used.
    jump_max : float
        Largest jump [m] of the odometry that is accepted.
    imu_latency : float
        Age of an IMU sample at reception [s].
    recovery_speed : float
        Largest velocity [m/s] at which a correction of the pose moves the tool. The noise of the
        odometry is excepted.

    Attributes
    ----------
    age : float
        Age of an odometry sample at reception, mean over 1 s [s]; NaN before the first sample.
    noise : (2,) ndarray
        Measured standard deviations of the odometry's position [m] and velocity [m/s].
    jumps : int
        Number of accepted jumps of the odometry.
    rejections : int
        Number of rejected odometry samples.
    """

    def __init__(
        self,
        frames: OdometryFrames,
        timeout: float = 0.2,
        jump_max: float = 0.5,
        imu_latency: float = 0.0,
        recovery_speed: float = 0.1,
    ) -> None:
        self._frames = frames
        self._timeout = positive('odometry_timeout', timeout)
        self._jump_max = positive('jump_max', jump_max)
        self._imu_latency = imu_latency
        self._speed_max = positive('recovery_speed', recovery_speed)
        self.age = np.nan
        self.jumps = self.rejections = 0
        self.noise = _NOISE.copy()
        self._rate_bias = np.zeros(3)
        # Smallest ages of the IMU in the earlier and in the present time, and its begin.
        self._ages, self._aged = (np.inf, np.inf), -np.inf
        self._offset, self._is_other_clock = 0.0, False  # the arm's clock minus the drone's [s]
        self._forget()

    def _forget(self) -> None:
        """Clear the filter, which the next odometry sample initializes."""
        self._state: _Predicted | None = None
        self._bias, self._variance = np.zeros(3), _FIRST.copy()
        self._rate, self._force = np.zeros(3), np.zeros(3)
        self._history: deque[_Predicted] = deque(maxlen=_HISTORY)
        self._imu_stamp = self._stamp = -np.inf
        self._interval = 0.0  # between the last two odometry samples [s]
        self._received = -np.inf  # time of the newest valid odometry, by the arm's clock
        self._good_since = np.inf
        self._doubted: tuple[float, Array] | None = None
        self._problem = ''
        self._frozen = FreezeWatch(_FROZEN)

    def problem(self, now: float) -> str:
        """Return a text if the pose cannot be used at `now` [s], otherwise an empty string."""
        if np.isinf(self._received):
            return f'odometry: {self._problem}' if self._problem else 'no odometry yet'
        age = now - self._received
        if self._problem and age > self._timeout:
            return f'odometry: {self._problem}'
        if not -self._timeout <= age <= self._timeout:
            return f'no usable odometry for {age:.2f} s'
        if now - self._good_since < _READY:
            return 'the odometry has just started'
        return ''

    def warning(self) -> str:
        """Return a text if the sensors are too poor to hold the tool, otherwise an empty one."""
        if self._is_other_clock and abs(self._offset) > _SAME_AGAIN:
            return (
                f'IMU: the samples arrive {min(self._ages):.3f} s after their stamps (imu_latency: '
                f'{self._imu_latency:g}), so the controller assumes that the clocks of drone and '
                'arm differ: synchronise them, or set imu_latency if this is the delay'
            )
        if self.age > _LATE:
            return (
                f'odometry: the samples are {self.age:.2f} s old on average: check the delay and '
                'the clock of the publisher'
            )
        if np.linalg.norm(self._rate_bias) > 0.99 * _RATE_BIAS_MAX:
            return (
                f'IMU: the bias of the gyroscope exceeds {_RATE_BIAS_MAX:g} rad/s: calibrate it, '
                "and check the IMU's orientation in the drone file or imu_frame"
            )
        return ''

    def accept_next(self) -> None:
        """Accept the next odometry even after a jump, as a new target refers to its frame."""
        if self._problem:
            self._forget()

    def offer_imu(self, sample: ImuSample, now: float) -> None:
        """Process a valid IMU sample that was received at `now` [s] on the arm's clock."""
        self._compare_clocks(sample.stamp, now)
        if -1.0 < sample.stamp - self._imu_stamp <= 0.0:
            return
        step = sample.stamp - self._imu_stamp
        self._imu_stamp = sample.stamp
        to_body = self._frames.imu_rotation
        rate = to_body @ sample.angular_velocity - self._rate_bias
        force = to_body @ sample.specific_force
        before = self._rate, self._force
        self._rate, self._force = rate, force
        if self._state is None:
            return
        if not 0.0 < step < _IMU_GAP:
            self._history.clear()
            self._history.append(self._state)
            before = rate, force
        ahead = sample.stamp - self._state.time
        if ahead <= 0.0:
            return
        self._predict(min(ahead, _IMU_GAP), 0.5 * (before[0] + rate), 0.5 * (before[1] + force))
        self._state = self._state._replace(time=sample.stamp)
        self._history.append(self._state)

    def offer_odometry(self, sample: OdometrySample, now: float) -> None:
        """Process a valid odometry sample that was received at `now` [s] on the arm's clock.

        Raises
        ------
        RejectedInputError
            If the sample is not newer than the previous one, too old, from another clock, frozen
            or a jump.
        """
        try:
            self._take(sample, now)
        except RejectedInputError as error:
            self.rejections += 1
            raise RejectedInputError(f'odometry: {error}') from None

    def pose(self, now: float) -> BasePose:
        """Return the base's pose at `now` [s] on the arm's clock; call `problem` first."""
        state = self._state
        assert state is not None
        step = min(max(self._drone_time(now) - state.time, 0.0), self._timeout)
        rate, frames = self._rate, self._frames
        rotation = state.rotation @ _turned(step * rate)
        acceleration = np.zeros(3)
        if self._has_imu(state.time):
            acceleration = state.rotation @ (self._force - self._bias) + _GRAVITY
        lever = frames.base_position - frames.imu_position
        velocity = state.velocity + step * acceleration
        place = state.position + step * (state.velocity + (0.5 * step) * acceleration)
        return BasePose(
            place + rotation @ lever,
            velocity + rotation @ cross(rate, lever),
            rotation @ frames.base_rotation,
            frames.base_rotation.T @ rate,
        )

    # Time.

    def _compare_clocks(self, stamp: float, now: float) -> None:
        age = now - stamp
        earlier, least = self._ages
        if age - min(earlier, least) > _CLOCK_STEP or now < self._aged:
            earlier = least = np.inf
        elif now - self._aged > _CLOCK_TIME:
            earlier, least = least, np.inf
        if np.isinf(least):
            self._aged = now
        self._ages = earlier, min(least, age)
        # The earliest arrival has the least delay.
        least = min(self._ages)
        plausible = _SAME_AGAIN if self._is_other_clock else _SAME_CLOCK
        self._is_other_clock = not 0.0 <= least <= self._imu_latency + plausible
        change = (least - self._imu_latency if self._is_other_clock else 0.0) - self._offset
        if self._state is not None and abs(change) < _OFFSET_STEP:
            # A step of the predicted time would be a step of the pose.
            most = _OFFSET_RATE * max(stamp - self._imu_stamp, 0.0)
            change = min(max(change, -most), most)
        self._offset += change

    def _drone_time(self, now: float) -> float:
        return now - self._offset

    def _has_imu(self, time: float) -> bool:
        return abs(time - self._imu_stamp) < _IMU_GAP

    # Prediction and correction.

    def _predict(self, step: float, rate: Array, force: Array | None) -> None:
        """Advance the prediction by `step` [s], given angular rate and specific force."""
        state = self._state
        assert state is not None
        acceleration, drive = np.zeros(3), _DRIVE_BLIND
        if force is not None:
            middle = state.rotation @ _turned(0.5 * step * rate)
            acceleration, drive = middle @ (force - self._bias) + _GRAVITY, _DRIVE
        self._state = _Predicted(
            state.time + step,
            state.position + step * (state.velocity + (0.5 * step) * acceleration),
            state.velocity + step * acceleration,
            state.rotation @ _turned(step * rate),
        )
        share = -step if force is not None else 0.0
        change = np.array([[1.0, step, 0.5 * step * share], [0.0, 1.0, share], [0.0, 0.0, 1.0]])
        self._variance = change @ self._variance @ change.T
        self._variance[1, 1] += step * drive
        self._variance[2, 2] += step * _BIAS_DRIVE

    def _take(self, sample: OdometrySample, now: float) -> None:
        if sample.stamp == self._stamp:
            self.rejections += 1  # a repeated sample is no fault
            return
        if -1.0 < sample.stamp - self._stamp < 0.0:
            raise RejectedInputError(
                'a sample is older than the previous one: run only one publisher'
            )
        age = self._drone_time(now) - sample.stamp
        if not -0.01 < age < self._timeout:
            self._problem = (
                f'a sample is {age:.2f} s old (odometry_timeout: {self._timeout:g}): check the '
                'delay and the clock of the publisher'
            )
            if age < 0.0:
                self._problem = (
                    f'a sample is {-age:.2f} s in the future: check the clock of the publisher'
                )
            if abs(age) > 5.0 * self._timeout:
                self._problem = (
                    f'the clock of the publisher is {-age:+.2f} s off: synchronise the clocks of '
                    'the publishers of odometry, IMU and joint_states'
                )
            raise RejectedInputError(self._problem)
        interval = self._interval = sample.stamp - self._stamp
        self._stamp = sample.stamp
        share = min(1.0, max(interval, 0.0) / _AGE_TIME) if np.isfinite(self.age) else 1.0
        self.age = age if share == 1.0 else self.age + share * (age - self.age)
        moving = max(
            float(np.linalg.norm(sample.velocity)) - _MOVING_SPEED,
            float(np.linalg.norm(self._rate)) - _MOVING_RATE,
        )
        reading = np.concatenate([sample.position, sample.attitude])
        if self._frozen.is_frozen(reading, sample.stamp, moving > 0.0):
            self._problem = 'the pose does not change while the drone moves (frozen)'
            raise RejectedInputError(self._problem)
        measured = self._measured(sample)
        is_set_back = now < self._received  # the arm's clock
        if self._state is None or is_set_back or not -_FORGOTTEN < interval < _FORGOTTEN:
            self._begin(measured, sample, now)
            return
        is_ahead = sample.stamp - self._state.time > _IMU_GAP
        if is_ahead or not self._has_imu(self._state.time) or not self._has_imu(sample.stamp):
            self._advance_blindly(sample)
        self._correct(measured, now)

    def _measured(self, sample: OdometrySample) -> _Predicted:
        """Return the state of the IMU that follows from an odometry sample."""
        rotation, lever = rotation_matrix(sample.attitude), self._frames.imu_position
        velocity = rotation @ (sample.velocity + cross(sample.rate, lever))
        return _Predicted(sample.stamp, sample.position + rotation @ lever, velocity, rotation)

    def _begin(self, measured: _Predicted, sample: OdometrySample, now: float) -> None:
        self._state = measured
        self._bias, self._variance = np.zeros(3), _FIRST.copy()
        self._history.clear()
        self._history.append(measured)
        if not self._has_imu(sample.stamp):
            self._rate = sample.rate
        self._accept(now)
        self._good_since = now

    def _accept(self, now: float) -> None:
        if now - self._received > self._timeout:
            self._good_since = now
        self._problem, self._doubted, self._received = '', None, now

    def _advance_blindly(self, sample: OdometrySample) -> None:
        """Extrapolate with the velocities of the odometry, because IMU samples are missing."""
        state = self._state
        assert state is not None
        self._rate = sample.rate
        step = sample.stamp - state.time
        if step > 0.0:
            self._predict(min(step, _IMU_GAP * 4.0), sample.rate, None)
            self._state = self._state._replace(time=sample.stamp)  # type: ignore[union-attr]
            self._history.append(self._state)

    def _at(self, time: float) -> _Predicted:
        """Return the predicted state at a past time, interpolated from the history."""
        earlier = self._history[0]
        for state in self._history:
            if state.time > time:
                if earlier.time >= time:
                    break
                share = (time - earlier.time) / (state.time - earlier.time)
                return _Predicted(
                    time,
                    earlier.position + share * (state.position - earlier.position),
                    earlier.velocity + share * (state.velocity - earlier.velocity),
                    earlier.rotation
                    @ _turned(share * rotation_vector(earlier.rotation.T @ state.rotation)),
                )
            earlier = state
        step = time - earlier.time
        return earlier._replace(
            time=time,
            position=earlier.position + step * earlier.velocity,
            rotation=earlier.rotation @ _turned(step * self._rate),
        )

    def _correct(self, measured: _Predicted, now: float) -> None:
        predicted = self._at(measured.time)
        off = measured.position - predicted.position
        faster = measured.velocity - predicted.velocity
        turn = rotation_vector(predicted.rotation.T @ measured.rotation)
        if self._has_jumped(off, turn, now):
            self._apply(self._history[0].time, off, np.zeros(3), _turned(turn))
            off = turn = np.zeros(3)
        share = 1.0 / _NOISE_SAMPLES
        matrix = self._variance[:2, :2] + np.diag(self.noise**2)
        gain = self._variance[:, :2] @ np.linalg.inv(matrix)
        left = np.array([off @ off, faster @ faster]) / 3.0 - np.diag(self._variance)[:2]
        # The difference from the prediction after a jump is not noise.
        left = np.minimum(np.maximum(left, 0.0), _OUTLIER * np.maximum(self.noise, _NOISE) ** 2)
        variance = (1.0 - share) * self.noise**2 + share * left
        self.noise = np.sqrt(np.maximum(variance, _NOISE_MIN**2))
        self._variance = self._variance - gain @ self._variance[:2]
        self._variance = 0.5 * (self._variance + self._variance.T)
        interval = now - self._received
        farthest = self._speed_max * interval
        largest = max(farthest / gain[0, 0], _NOISE_SHARE * float(self.noise[0]))
        spread = float(np.sqrt(matrix[1, 1]))
        faster = limited(faster, self._speed_max + _NOISE_SHARE * spread)
        shift, change, bias = gain @ np.array([limited(off, largest), faster])
        part = min(interval, _ATTITUDE_TIME) / _ATTITUDE_TIME
        most = max(farthest / _LEVER, _RATE_BIAS_MAX * interval)
        correction = _turned(limited(part * turn, most))
        is_step = float(np.linalg.norm(turn)) > _RATE_BIAS_STEP
        if not is_step and self._has_imu(measured.time) and interval < self._timeout:
            # Attitude and bias form a critically damped filter.
            off_rate = part / (4.0 * _ATTITUDE_TIME) * limited(turn, _RATE_BIAS_TURN)
            self._rate_bias = limited(self._rate_bias - off_rate, _RATE_BIAS_MAX)
        self._apply(measured.time, shift, change, correction)
        bias = self._bias + predicted.rotation.T @ bias
        self._bias = np.minimum(np.maximum(bias, -_BIAS_MAX), _BIAS_MAX)
        self._accept(now)

    def _apply(self, time: float, shift: Array, change: Array, correction: Array) -> None:
        """Correct all stored predictions from a time on, by an error found at that time."""
        corrected = [
            _Predicted(
                state.time,
                state.position + shift + (state.time - time) * change,
                state.velocity + change,
                state.rotation @ correction,
            )
            for state in self._history
            if state.time >= time - _IMU_GAP
        ]
        self._history.clear()
        self._history.extend(corrected)
        self._state = corrected[-1]

    def _has_jumped(self, off: Array, turn: Array, now: float) -> bool:
        """Check for a jump of the odometry; return whether one persists and is accepted."""
        # A doubtful sample also ends a time without samples, because a jump must not count as
        # growing error.
        silent = min(max(self._interval, 0.0), _FORGOTTEN)
        spread = np.sqrt(self._variance[0, 0] + self.noise[0] ** 2)
        allowed = min(_JUMP + _DEVIATIONS * float(spread) + _GROWTH * silent, self._jump_max)
        distance, angle = float(np.linalg.norm(off)), float(np.linalg.norm(turn))
        if distance <= allowed and angle <= _TURN:
            return False
        self._problem = f'the pose jumped by {distance:.2f} m and {angle:.2f} rad'
        if distance > self._jump_max or angle > self._jump_max:
            self._problem += (
                f' (jump_max: {self._jump_max:g}): check the odometry, or send a new target'
            )
            raise RejectedInputError(self._problem)
        before = self._doubted
        if before is None or float(np.linalg.norm(off - before[1])) > allowed:
            before = self._doubted = now, off
        if now - before[0] < _DOUBT:
            raise RejectedInputError(self._problem)
        self.jumps += 1
        self._problem = ''
        return True


def _turned(turn: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector [rad]."""
    x, y, z = turn.tolist()
    angle = (x * x + y * y + z * z) ** 0.5
    if angle < 1e-9:
        return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / (angle * angle)
    return np.array(
        [
            [1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)],
        ]
    )


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vector (3,) [rad] of a rotation by less than half a turn."""
    half = 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = float(np.sqrt(half @ half))
    if sine < 1e-9:
        return half
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    turn: Array = (angle / sine) * half
    return turn
