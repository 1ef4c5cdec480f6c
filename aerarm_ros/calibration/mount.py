"""Poses of the arm's base and of the IMU on a drone, from a recording of the moving drone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

from aerarm_ros.calibration.choice import check_unknowns
from aerarm_ros.calibration.fit import Fit, fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import (
    CalibrationError,
    MarkerSource,
    Observations,
    base_pose,
    cross_matrix,
)
from aerarm_ros.calibration.plateaus import Track, time_offset
from aerarm_ros.description.config_reader import read_yaml, yaml_text
from aerarm_ros.motion.signals import Array

GRAVITY = 9.81  # [m/s^2]
_SAMPLES = 600  # number of motion-capture frames used for the mount fit
_STEPS = (0.02, 0.005, 0.001)  # [s] step sizes of the search for the time offset
_SEARCH = 0.03  # [s] search range around the time offset estimated from speeds
_RATE = 200.0  # [Hz] common sampling rate of IMU and pose
_SMOOTH = 0.08  # [s] standard deviation of the smoothing window
_BIAS = 0.3  # [m/s^2] prior standard deviation of the accelerometer's bias
_TILT = 0.5  # [m/s^2] prior standard deviation of gravity across the z axis of the pose's frame
_LEAST_TURN = 0.15  # [rad] rotation of the drone below which the IMU pose is not identifiable
_ITERATIONS = 20
_MISFIT = 0.005  # [m] largest noise of the markers after the fit
# [m], [rad] largest standard deviations of the mount; an arm that hardly moves exceeds them
_UNCERTAIN_POSITION, _UNCERTAIN_ROTATION = 0.01, 0.03


@dataclass(frozen=True, eq=False)
class FramePose:
    """Pose of a frame relative to the drone's body, with standard deviations.

    Attributes
    ----------
    position : (3,) ndarray
        Position [m].
    position_std, rotation_std : (3,) ndarray
        Standard deviations [m], [rad] about the body's axes.
    """

    position: Array
    rotation: Array
    position_std: Array
    rotation_std: Array

    @property
    def rpy(self) -> Array:
        """Roll, pitch and yaw (3,) [rad], in the convention of URDF."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_euler('xyz'))


@dataclass(frozen=True, eq=False)
class MountResult:
    """Estimated pose of the arm's base on the drone.

    Attributes
    ----------
    fit : Fit
        Fit to the markers in the body frame.
    late : float
        Time by which the stamps of the joint states lag behind those of the motion capture [s].
    """

    pose: FramePose
    fit: Fit
    late: float


@dataclass(frozen=True, eq=False)
class ImuResult:
    """Estimated pose of the IMU on the drone.

    Attributes
    ----------
    late : float
        Time by which the stamps of the IMU lag behind those of the drone poses [s].
    bias : (3,) ndarray
        Bias of the accelerometer, in the IMU's axes [m/s^2].
    """

    pose: FramePose
    late: float
    bias: Array


def calibrate_mount(
    geometry: ArmGeometry, time: Array, q: Array, drone: Track, markers: Sequence[Track]
) -> MountResult:
    """Estimate the pose of the arm's base on the drone.

    Markers on the arm, expressed in the drone's body frame, move like markers on an arm with a
    fixed base. The fitted pose of the arm's base in this frame is therefore the pose of the mount.

    Parameters
    ----------
    geometry : ArmGeometry
        Calibrated geometry.
    time : (T,) ndarray
        Time of the joint states [s].
    q : (T, n) ndarray
        Joint positions [rad].
    drone : Track
        Pose of the drone's body, in the frame of the marker positions.
    markers : sequence of Track
        Markers on the link `geometry.link`.

    Raises
    ------
    CalibrationError
        If the arm hardly moves, the markers do not fit, or the recordings do not overlap.
    """
    if not markers:
        raise CalibrationError('the arm has no markers: attach at least one marker to the arm')
    seen = [_in_body(track, drone) for track in markers]
    frames, position = _frames(seen, time)
    offsets = [time_offset(time, q, track) for track in seen]
    late = max(offsets, key=lambda one: one[1])[0]
    names = tuple(track.name for track in seen)

    def at(shift: float, start: Fit | None = None) -> Fit:
        own = _interpolated(frames - shift, time, q)
        observations = Observations(own, (MarkerSource('mount', names, position),))
        if start is None:
            return registered(geometry, observations)
        return fitted(start, (), observations)

    fit = at(late)
    check_unknowns(fit)
    if fit.length <= _MISFIT:  # else the time offset or the markers are wrong
        _check_deviations(fit)
    for step in _STEPS:
        shifts = late + step * np.arange(-2, 3)
        fits = [at(shift, fit) for shift in shifts]
        best = int(np.argmin([one.length for one in fits]))
        late, fit = float(shifts[best]), fits[best]
    if fit.length > _MISFIT:
        raise CalibrationError(
            f'the markers are {1000.0 * fit.length:.0f} mm from their predicted positions: check '
            'that markers and drone poses use one frame, and calibrate the arm first'
        )
    rotation, translation = base_pose(fit.states[0])
    deviations = _check_deviations(fit)
    pose = FramePose(translation, rotation, deviations[:3], deviations[3:6])
    return MountResult(pose, fit, -late)


def _check_deviations(fit: Fit) -> Array:
    """Return the standard deviations of mount and marker positions; reject an uncertain mount."""
    deviations = fit.deviations
    position, rotation = max(deviations[:3]), max(deviations[3:6])
    if position > _UNCERTAIN_POSITION or rotation > _UNCERTAIN_ROTATION:
        raise CalibrationError(
            f'the estimated mount is uncertain by {1e3 * position:.0f} mm and '
            f'{1e3 * rotation:.0f} mrad: move every joint by more than 0.5 rad'
        )
    return deviations


def calibrate_imu(drone: Track, time: Array, rate: Array, force: Array) -> ImuResult:
    """Estimate the pose of the IMU on the drone.

    One smoothing window is applied to both sides of ``R_WI f + g = p'' + R'' r``, with specific
    force f, gravity g, body position p and rotation R, and the position r of the IMU on the body.
    Derivatives are taken of the window function instead of the noisy signals, and the equation is
    linear in r. The measured angular rates determine the rotation of the IMU.

    Parameters
    ----------
    drone : Track
        Pose of the body in a frame with approximately vertical z axis.
    time : (T,) ndarray
        Time of the IMU samples [s].
    rate, force : (T, 3) ndarray
        Angular velocity [rad/s] and specific force [m/s^2] in the IMU's axes.

    Raises
    ------
    CalibrationError
        If the drone turns too little, or the recordings do not overlap.
    """
    assert drone.rotation is not None
    body_time, body_rate = _body_rates(drone)
    late, agreement = _rate_offset(body_time, body_rate, time, rate)
    if agreement < 0.5:
        raise CalibrationError(
            'the rotations of IMU and drone disagree: check that --imu and --drone-pose belong '
            'to one drone, and that the drone turns by 20 degrees about two axes'
        )
    own_time = time - late
    first, last = max(own_time[0], drone.time[0]) + 0.3, min(own_time[-1], drone.time[-1]) - 0.3
    if last - first < 5.0:
        raise CalibrationError(
            'the recordings of IMU and drone poses overlap for less than 5 s: record both at the '
            'same time'
        )
    grid = np.arange(first, last, 1.0 / _RATE)

    def shifted(more: float) -> _ImuData:
        return _ImuData(drone, own_time - more, rate, force, grid)

    def misfit(more: float) -> float:
        return _rotation_by_rates(shifted(more))[2]

    more = float(
        minimize_scalar(
            misfit, bounds=(-_SEARCH, _SEARCH), method='bounded', options={'xatol': 1e-5}
        ).x
    )
    return _solved_imu(shifted(more), late + more)


class _ImuData:
    """IMU samples and drone poses on a common time grid, smoothed by the same window."""

    def __init__(self, drone: Track, time: Array, rate: Array, force: Array, grid: Array) -> None:
        assert drone.rotation is not None
        order = np.argsort(drone.time)
        turns = Rotation.from_matrix(drone.rotation[order])
        at = drone.time[order]
        self.rotation = Slerp(at, turns)(grid).as_matrix()
        position = _interpolated(grid, at, drone.position[order])
        self.rate, self.force = _interpolated(grid, time, rate), _interpolated(grid, time, force)
        self._sigma = _SMOOTH * _RATE
        skip = int(4.0 * self._sigma)
        self.inside = slice(skip, len(grid) - skip)
        turned = np.swapaxes(self.rotation[:-1], 1, 2) @ self.rotation[1:]
        body = Rotation.from_matrix(turned).as_rotvec() * _RATE
        body = np.vstack([body, body[-1:]])
        # The difference of two samples is the mean rate between them, half a sample after the
        # first.
        self.body_rate = self.smooth(0.5 * (body + np.roll(body, 1, axis=0)))
        self.own_rate = self.smooth(self.rate)
        self.acceleration = self.second(position)
        self.lever = self.second(self.rotation.reshape(len(grid), 9)).reshape(-1, 3, 3)

    def smooth(self, values: Array) -> Array:
        """Return the smoothed values, without the samples at both ends."""
        return np.asarray(gaussian_filter1d(values, self._sigma, axis=0)[self.inside])

    def second(self, values: Array) -> Array:
        """Return the second derivative of smoothed values, without the samples at both ends."""
        found = gaussian_filter1d(values, self._sigma, axis=0, order=2) * _RATE**2
        return np.asarray(found[self.inside])


def _solved_imu(data: _ImuData, late: float) -> ImuResult:
    rotation, rate_bias, _ = _rotation_by_rates(data)
    values = np.zeros(9)  # lever, accelerometer bias, horizontal gravity
    count = len(data.acceleration)
    force = data.force
    covariance = np.zeros((12, 12))
    for _ in range(_ITERATIONS):
        to_world = data.rotation @ rotation
        turned = np.einsum('mij,mj->mi', to_world, force)
        measured = data.smooth(turned)
        of_bias = data.smooth(to_world.reshape(len(to_world), 9)).reshape(-1, 3, 3)
        # A small rotation of the IMU about the body's axes: R_WB [d]x R_BI f.
        in_body = force @ rotation.T
        cross = cross_matrix(in_body)
        of_turn = -data.smooth((data.rotation @ cross).reshape(len(cross), 9)).reshape(-1, 3, 3)
        gravity = np.array([0.0, 0.0, -GRAVITY]) + values[6:]
        residual = (
            measured
            - np.einsum('mij,j->mi', of_bias, values[3:6])
            + gravity
            - data.acceleration
            - np.einsum('mij,j->mi', data.lever, values[:3])
        )
        columns = np.concatenate(
            [of_turn, -data.lever, -of_bias, np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2
        )
        step, covariance = _weighted_step(data, rotation, rate_bias, residual, columns, values)
        rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        values += step[3:]
        if float(np.abs(step).max()) < 1e-9:
            break
    deviation = np.sqrt(np.diag(covariance))
    pose = FramePose(values[:3], rotation, deviation[3:6], deviation[:3])
    return ImuResult(pose, late, values[3:6])


def _weighted_step(
    data: _ImuData, rotation: Array, rate_bias: Array, force: Array, columns: Array, values: Array
) -> tuple[Array, Array]:
    """Return a Gauss-Newton step (12,) of the IMU's unknowns, and the step's covariance.

    Smoothed samples are correlated within the window, so only the independent ones count.
    """
    expected = (data.own_rate - rate_bias) @ rotation.T
    rates = expected - data.body_rate
    of_turn = -cross_matrix(expected)
    alike = 2.0 * np.sqrt(np.pi) * _SMOOTH * _RATE
    info, gradient = np.zeros((12, 12)), np.zeros(12)
    for residual, matrix, places in ((force, columns, slice(0, 12)), (rates, of_turn, slice(0, 3))):
        noise = float(np.var(residual - residual.mean(axis=0))) * alike
        info[places, places] += np.einsum('mki,mkj->ij', matrix, matrix) / noise
        gradient[places] += np.einsum('mki,mk->i', matrix, residual) / noise
    prior = np.zeros(12)
    prior[6:9], prior[9:12] = 1.0 / _BIAS**2, 1.0 / _TILT**2
    info += np.diag(prior)
    gradient[3:] += prior[3:] * values
    covariance: Array = np.asarray(np.linalg.inv(info), dtype=float)
    return -covariance @ gradient, covariance


def _rotation_by_rates(data: _ImuData) -> tuple[Array, Array, float]:
    """Return the IMU's rotation on the body, gyroscope bias and residual (Kabsch's method)."""
    body = data.body_rate - data.body_rate.mean(axis=0)
    own = data.own_rate - data.own_rate.mean(axis=0)
    strength = np.linalg.svd(body, compute_uv=False) / np.sqrt(len(body))
    if strength[1] < _LEAST_TURN:
        raise CalibrationError(
            f'the drone turns too slowly about a second axis ({strength[1]:.2g} rad/s): record '
            'a flight, or a motion by hand, that rolls, pitches and yaws by 20 degrees'
        )
    left, _, right = np.linalg.svd(body.T @ own)
    sign = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    rotation = left @ sign @ right
    bias = data.own_rate.mean(axis=0) - data.body_rate.mean(axis=0) @ rotation
    return rotation, bias, float(np.mean((own @ rotation.T - body) ** 2))


def _body_rates(drone: Track) -> tuple[Array, Array]:
    assert drone.rotation is not None
    turned = np.swapaxes(drone.rotation[:-1], 1, 2) @ drone.rotation[1:]
    step = np.diff(drone.time)
    rates = Rotation.from_matrix(turned).as_rotvec() / step[:, None]
    return 0.5 * (drone.time[:-1] + drone.time[1:]), np.asarray(rates, dtype=float)


def _rate_offset(time: Array, rate: Array, other_time: Array, other: Array) -> tuple[float, float]:
    """Return the delay [s] of the stamps of `other` relative to `rate`, and the correlation."""
    speeds = [np.linalg.norm(values, axis=1) for values in (rate, other)]
    # `time_offset` differentiates its input, so pass total angles.
    walks = [
        np.concatenate([[0.0], np.cumsum(0.5 * (s[1:] + s[:-1]) * np.diff(t))])
        for s, t in zip(speeds, (time, other_time), strict=True)
    ]
    track = Track('imu', other_time, np.column_stack([walks[1], *2 * [np.zeros(len(other))]]))
    return time_offset(time, walks[0][:, None], track)


def _in_body(track: Track, drone: Track) -> Track:
    """Return a marker's positions over time in the body frame of the drone."""
    assert drone.rotation is not None
    inside = (track.time >= drone.time[0]) & (track.time <= drone.time[-1])
    inside &= np.isfinite(track.position).all(axis=1)
    if inside.sum() < 50:
        raise CalibrationError(
            f'only {int(inside.sum())} motion-capture frames contain both marker {track.name} and '
            'the drone: record both for at least 20 s'
        )
    time = track.time[inside]
    turn = Slerp(drone.time, Rotation.from_matrix(drone.rotation))(time)
    place = _interpolated(time, drone.time, drone.position)
    return Track(track.name, time, turn.inv().apply(track.position[inside] - place))


def _frames(tracks: Sequence[Track], time: Array) -> tuple[Array, Array]:
    """Return frame times (M,) and marker positions (M, K, 3); NaN where a marker is not visible."""
    common = np.unique(np.concatenate([track.time for track in tracks]))
    common = common[(common > time[0] + 0.5) & (common < time[-1] - 0.5)]
    common = common[:: max(1, len(common) // _SAMPLES)]
    if len(common) < 50:
        raise CalibrationError(
            'fewer than 50 motion-capture frames overlap with the joint states: record both at the '
            'same time'
        )
    position = np.full((len(common), len(tracks), 3), np.nan)
    for k, track in enumerate(tracks):
        place = np.clip(np.searchsorted(track.time, common), 0, len(track.time) - 1)
        same = np.abs(track.time[place] - common) < 1e-6
        position[same, k] = track.position[place[same]]
    return common, position


def _interpolated(at: Array, time: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at, time, column) for column in values.T])


_HEADER = """\
# Drone configuration with the calibrated pose of the arm's base (mount) or of the IMU, or both,
# in place of the nominal poses. Comments of the original configuration are omitted.
"""


def drone_yaml(source: Path, mount: FramePose | None, imu: FramePose | None) -> str:
    """Return a drone file with the calibrated poses.

    Raises
    ------
    ConfigError
        If the file cannot be read.
    """
    document = read_yaml(source)
    for key, pose in (('mount', mount), ('imu', imu)):
        if pose is not None:
            document[key] = {
                'position': [round(float(x), 6) for x in pose.position],
                'rpy': [round(float(x), 6) for x in pose.rpy],
            }
    return _HEADER + yaml_text(document)
