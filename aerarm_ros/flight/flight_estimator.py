"""Estimation of the drone's state from odometry and IMU, and detection of sensor faults."""

import numpy as np

from aerarm_ros.control.base.base_motion import ImuSample, rotation_matrix
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.flight_state import FlightState, OdometrySample
from aerarm_ros.motion.signals import Array


class FreezeWatch:
    """Detects a sensor that repeats exactly the same value.

    Parameters
    ----------
    patience : float
        Time [s] after which a constant reading counts as frozen, if the drone moves.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._last: Array | None = None
        self._since = 0.0

    def is_frozen(self, reading: Array, now: float, is_moving: bool) -> bool:
        """Process a reading at `now` [s]; return whether the sensor of a moving drone is frozen."""
        if self._last is None or not np.array_equal(reading, self._last) or not is_moving:
            self._last, self._since = reading, now
        return now - self._since > self._patience


SILENCE = 0.1
"""Time [s] without a good sample after which the estimator ignores a sensor."""

_FROZEN = 0.1  # [s]
_MOVING_RATE, _MOVING_SPEED = 0.05, 0.05  # [rad/s], [m/s]
# Largest difference between a sample and its prediction: place [m], tilt [rad], speed [m/s],
# angular velocity [rad/s]. A jump must stay for a time [s] before it is accepted.
_PLACE, _TURN, _SPEED, _RATE = 0.3, 0.3, 2.0, 6.0
_DOUBT = 0.3
_FORGOTTEN = 1.0  # [s] after which the last sample no longer predicts the drone's place
_GYRO_DOUBT = 3.0  # [rad/s] between IMU and odometry
_AGE_MAX = 0.1  # [s] longest extrapolation of an old odometry


class FlightEstimator:
    """Checks samples of odometry and IMU, and combines them to a `FlightState`.

    Position, velocity and attitude come from the odometry, extrapolated by its age with the IMU's
    angular velocity. The state's angular velocity comes from the IMU if its samples arrive. A
    sample is rejected with a reason if it is invalid, old, frozen while the other sensor shows
    motion, or an impossible jump. A jump that persists for 0.3 s is accepted as a reset of the
    odometry's frame.

    Parameters
    ----------
    drone : DroneConfig
        Drone with the position of its IMU.

    Attributes
    ----------
    jumps : int
        Number of accepted jumps. After each jump, positions refer to a new odometry frame.
    """

    def __init__(self, drone: DroneConfig) -> None:
        self._to_body = drone.imu.rotation
        self._odometry: OdometrySample | None = None
        self._imu: ImuSample | None = None
        self._doubted: OdometrySample | None = None
        self._doubted_since = 0.0
        self._frozen_odometry, self._frozen_imu = FreezeWatch(_FROZEN), FreezeWatch(_FROZEN)
        self.jumps = 0

    def offer_odometry(self, sample: OdometrySample) -> None:
        """Process an odometry sample; raises RejectedInputError."""
        before = self._odometry
        _require_newer('odometry', before, sample)
        self._refuse_frozen_odometry(sample)
        if before is not None and sample.stamp > before.stamp:
            self._refuse_jump(before, sample)
        self._odometry, self._doubted = sample, None

    def offer_imu(self, sample: ImuSample) -> None:
        """Process an IMU sample; raises RejectedInputError."""
        before, odometry = self._imu, self._odometry
        _require_newer('IMU', before, sample)
        rate = self._to_body @ sample.angular_velocity
        if odometry is not None and abs(sample.stamp - odometry.stamp) < SILENCE:
            is_moving = float(np.linalg.norm(odometry.rate)) > _MOVING_RATE
            reading = np.concatenate([sample.angular_velocity, sample.specific_force])
            if self._frozen_imu.is_frozen(reading, sample.stamp, is_moving):
                raise RejectedInputError(
                    'IMU: repeated samples although the drone turns (frozen); check the driver'
                )
            if np.linalg.norm(rate - odometry.rate) > _GYRO_DOUBT:
                raise RejectedInputError(
                    'IMU: its angular velocity differs from that of the odometry; the odometry '
                    "jumped, or the IMU's pose in the drone file is wrong"
                )
        self._imu = sample

    @property
    def stamp(self) -> float | None:
        """Stamp of the newest valid sample [s], None before the first."""
        stamps = [sample.stamp for sample in (self._odometry, self._imu) if sample is not None]
        return max(stamps, default=None)

    def missing(self) -> list[str]:
        """Return the names of the sensors (odometry, imu) without a recent valid sample."""
        now = self.stamp
        names = ('odometry', self._odometry), ('imu', self._imu)
        return [
            name for name, sample in names if now is None or sample is None or _is_old(sample, now)
        ]

    def state(self) -> FlightState | None:
        """Return the drone's state at the time `stamp`, None while the odometry is missing."""
        now, odometry = self.stamp, self._odometry
        if odometry is None or now is None or _is_old(odometry, now):
            return None
        rotation = rotation_matrix(odometry.attitude)
        age = min(max(now - odometry.stamp, 0.0), _AGE_MAX)
        rate = self._rate(now)
        velocity = rotation @ odometry.velocity
        turned = rotation @ rotation_matrix(_quaternion(age * rate))
        force = None
        if self._imu is not None and not _is_old(self._imu, now):
            force = self._to_body @ self._imu.specific_force
        return FlightState(odometry.position + age * velocity, velocity, turned, rate, force)

    def attitude_alone(self) -> FlightState | None:
        """Return a state with the IMU's attitude and zero position; None without attitude."""
        now, imu = self.stamp, self._imu
        if imu is None or imu.attitude is None or now is None or _is_old(imu, now):
            return None
        rotation = rotation_matrix(imu.attitude) @ self._to_body.T
        return FlightState(np.zeros(3), np.zeros(3), rotation, self._to_body @ imu.angular_velocity)

    def _rate(self, now: float) -> Array:
        if self._imu is not None and not _is_old(self._imu, now):
            return np.asarray(self._to_body @ self._imu.angular_velocity)
        assert self._odometry is not None
        return self._odometry.rate

    def _refuse_frozen_odometry(self, sample: OdometrySample) -> None:
        imu = self._imu
        turns = imu is not None and abs(imu.stamp - sample.stamp) < SILENCE
        is_moving = float(np.linalg.norm(sample.velocity)) > _MOVING_SPEED
        if imu is not None and turns:
            is_moving |= float(np.linalg.norm(imu.angular_velocity)) > _MOVING_RATE
        reading = np.concatenate([sample.position, sample.attitude])
        if self._frozen_odometry.is_frozen(reading, sample.stamp, is_moving):
            raise RejectedInputError(
                'odometry: repeated pose although the drone moves (frozen); check its source'
            )

    def _refuse_jump(self, before: OdometrySample, sample: OdometrySample) -> None:
        step = sample.stamp - before.stamp
        jump = _jump(before, sample) if step < _FORGOTTEN else ''
        if not jump:
            if step >= _FORGOTTEN:
                self.jumps += 1
            return
        doubted = self._doubted
        if doubted is None or _jump(doubted, sample):
            self._doubted_since = sample.stamp  # differs from the previous jump too
        self._doubted = sample
        if sample.stamp - self._doubted_since < _DOUBT:
            raise RejectedInputError(jump)
        self.jumps += 1


def _require_newer(
    what: str, before: OdometrySample | ImuSample | None, sample: OdometrySample | ImuSample
) -> None:
    if before is not None and before.stamp - 1.0 < sample.stamp <= before.stamp:
        raise RejectedInputError(
            f'{what}: a sample is not newer than the previous one; run only one publisher'
        )


def _is_old(sample: OdometrySample | ImuSample, now: float) -> bool:
    return now - sample.stamp > SILENCE


def _jump(before: OdometrySample, sample: OdometrySample) -> str:
    """Return a text on an impossible change between two samples, or an empty string."""
    step = sample.stamp - before.stamp
    rotation = rotation_matrix(before.attitude)
    place = before.position + step * (rotation @ before.velocity)
    distance = float(np.linalg.norm(sample.position - place))
    turned = rotation @ rotation_matrix(_quaternion(step * before.rate))
    cosine = 0.5 * (float(np.trace(turned.T @ rotation_matrix(sample.attitude))) - 1.0)
    angle = float(np.arccos(min(max(cosine, -1.0), 1.0)))
    velocity = rotation_matrix(sample.attitude) @ sample.velocity - rotation @ before.velocity
    for what, size, limit, unit in (
        ('position', distance, _PLACE + 10.0 * step**2, 'm'),
        ('attitude', angle, _TURN + 3.0 * step, 'rad'),
        ('velocity', float(np.linalg.norm(velocity)), _SPEED + 20.0 * step, 'm/s'),
        (
            'angular velocity',
            float(np.linalg.norm(sample.rate - before.rate)),
            _RATE + 50.0 * step,
            'rad/s',
        ),
    ):
        if size > limit:
            return f'odometry: the {what} jumps by {size:.2f} {unit} between two samples'
    return ''


def _quaternion(turn: Array) -> Array:
    """Return the quaternion (x, y, z, w) of a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    share = 0.5 * np.sinc(0.5 * angle / np.pi)
    return np.append(share * turn, np.cos(0.5 * angle))
