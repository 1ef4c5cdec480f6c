"""Rest periods in a recording, and the time offset between recorded sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate
from scipy.spatial.transform import Rotation

from aerarm_ros.calibration.observations import (
    CalibrationError,
    MarkerSource,
    Observations,
    PoseSource,
    Source,
)
from aerarm_ros.motion.signals import Array

_STILL = 2e-3  # [rad], [m] tolerated motion of a joint at rest within the window
_WINDOW = 0.25  # [s]
_SHORTEST = 0.4  # [s] shortest rest period that is used
# [s] time excluded at the start of a rest period; half of it is excluded at the end
_SETTLING = 0.15
_RATE = 200.0  # [Hz] sampling rate for comparing speeds
_LARGEST_OFFSET = 6.0  # [s] search range
_SMOOTH = 0.05  # [s] smoothing of speeds
_AGREES = 0.5  # correlation of speeds below which the offset is undetermined


@dataclass(frozen=True, eq=False)
class Track:
    """Measurements of one marker or pose over time.

    Attributes
    ----------
    time : (T,) ndarray
        Time [s].
    position : (T, 3) ndarray
        Position [m].
    rotation : (T, 3, 3) ndarray or None
        Rotation matrix; None for a marker.
    """

    name: str
    time: Array
    position: Array
    rotation: Array | None = None


@dataclass(frozen=True, eq=False)
class RestingArm:
    """Periods of a recording in which the arm is at rest.

    Attributes
    ----------
    start, end : (M,) ndarray
        Start and end of each rest period [s] on the clock of the joint states, without the time
        in which the arm settles.
    q : (M, n) ndarray
        Mean joint positions in each rest period [rad].
    """

    start: Array
    end: Array
    q: Array


def resting_arm(time: Array, q: Array) -> RestingArm:
    """Return rest periods: 0.4 s or more, joint motion within any 0.25 s at most 2 mrad.

    Parameters
    ----------
    time : (T,) ndarray
        Increasing time [s].
    q : (T, n) ndarray
        Joint positions [rad].
    """
    ahead = np.minimum(np.searchsorted(time, time + _WINDOW), len(time) - 1)
    moved = np.abs(q[ahead] - q).max(axis=1)
    # Also check the middle of the window, because an oscillating joint may be back at its end.
    half = np.minimum(np.searchsorted(time, time + 0.5 * _WINDOW), len(time) - 1)
    moved = np.maximum(moved, np.abs(q[half] - q).max(axis=1))
    still = moved < _STILL
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    start, end, means = [], [], []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        begin, finish = time[first] + _SETTLING, time[past - 1] - 0.5 * _SETTLING
        if finish - begin < _SHORTEST - _SETTLING:
            continue
        inside = (time >= begin) & (time <= finish)
        if inside.sum() < 2:
            continue
        start.append(begin)
        end.append(finish)
        means.append(q[inside].mean(axis=0))
    width = q.shape[1]
    return RestingArm(np.array(start), np.array(end), np.array(means).reshape(-1, width))


def time_offset(time: Array, q: Array, track: Track) -> tuple[float, float]:
    """Return the delay of a track's stamps relative to the stamps of the joint states.

    The delay aligns the speed of the track with the speed of the joints. The maximum of the
    cross-correlation of both speeds, interpolated by a parabola, gives the delay.

    Returns
    -------
    offset : float
        Delay [s]; 0 if the speeds do not agree.
    correlation : float
        Correlation of the speeds at this delay.
    """
    first, last = max(time[0], track.time[0]), min(time[-1], track.time[-1])
    seen = np.isfinite(track.position).all(axis=1)
    if last - first < 2.0 or seen.sum() < 10:
        return 0.0, 0.0
    grid = np.arange(min(time[0], track.time[0]), max(time[-1], track.time[-1]), 1.0 / _RATE)
    own = _speed(grid, time, q)
    other = _speed(grid, track.time[seen], track.position[seen])
    lags = int(_LARGEST_OFFSET * _RATE)
    correlation = _correlation(other, own, lags)
    best = int(np.argmax(correlation))
    peak = float(correlation[best])
    if peak < _AGREES or not 0 < best < 2 * lags:
        return 0.0, peak
    left, middle, right = correlation[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float((best - lags + shift) / _RATE), peak


def rest_observations(
    rests: RestingArm,
    tracks: Sequence[Track],
    offsets: Mapping[str, float],
    eye_in_hand: Sequence[str] = (),
) -> Observations:
    """Return the mean marker positions and body poses of each rest period.

    Parameters
    ----------
    offsets : mapping
        Delay of the stamps by track name [s].
    eye_in_hand : sequence of str
        Pose tracks measured by a camera on the arm.

    Raises
    ------
    CalibrationError
        If the arm is never at rest, or no rest period contains measurements.
    """
    if not len(rests.q):
        raise CalibrationError(
            f'the recording has no rest period of {_SHORTEST:g} s: let the arm rest for one '
            'second in each posture, as `arm calibrate` does'
        )
    sources = sources_of([_means(rests, track, offsets) for track in tracks], eye_in_hand)
    labels = tuple(f'rest {k + 1} at {begin:.1f} s' for k, begin in enumerate(
        rests.start - rests.start[0]))  # fmt: skip
    if not any(source.seen.any() for source in sources):
        raise CalibrationError(
            'no sensor measured anything while the arm rested: check that sensors and joint states '
            'use the same clock for their stamps'
        )
    return Observations(rests.q, sources, labels)


def rotations(quaternion: Array) -> Array:
    """Return rotation matrices (M, 3, 3) of quaternions (M, 4) as x, y, z, w; NaN if invalid."""
    found = np.full((len(quaternion), 3, 3), np.nan)
    norm = np.linalg.norm(quaternion, axis=1)
    seen = np.isfinite(norm) & (norm > 0.5)
    found[seen] = Rotation.from_quat(quaternion[seen]).as_matrix()
    return found


def sources_of(tracks: Sequence[Track], eye_in_hand: Sequence[str] = ()) -> tuple[Source, ...]:
    """Return the sources of measurements whose rows are postures of the arm at rest."""
    sources: list[Source] = []
    markers = [track for track in tracks if track.rotation is None]
    if markers:
        position = np.stack([one.position for one in markers], axis=1)
        sources.append(MarkerSource('mocap', tuple(one.name for one in markers), position))
    return (
        *sources,
        *(
            PoseSource(one.name, one.rotation, one.position, one.name in eye_in_hand)
            for one in tracks
            if one.rotation is not None
        ),
    )


def _means(rests: RestingArm, track: Track, offsets: Mapping[str, float]) -> Track:
    """Return the mean measurement of each rest period, NaN without measurements."""
    late, rotation = offsets.get(track.name, 0.0), track.rotation
    place, turn = np.full((len(rests.q), 3), np.nan), np.full((len(rests.q), 3, 3), np.nan)
    seen = np.isfinite(track.position).all(axis=1)
    if rotation is not None:
        seen &= np.isfinite(rotation).all(axis=(1, 2))
    for k, (begin, end) in enumerate(zip(rests.start, rests.end, strict=True)):
        inside = (track.time >= begin + late) & (track.time <= end + late) & seen
        if inside.any():
            # A single outlier among many camera frames must not change the mean.
            place[k] = _robust_mean(track.position[inside])
            if rotation is not None:
                turn[k] = Rotation.from_matrix(rotation[inside]).mean().as_matrix()
    return Track(track.name, rests.start, place, None if rotation is None else turn)


def _robust_mean(values: Array) -> Array:
    middle = np.median(values, axis=0)
    off = np.linalg.norm(values - middle, axis=1)
    near = off <= max(4.0 * float(np.median(off)), 1e-9)
    return np.asarray(values[near].mean(axis=0))


def _speed(grid: Array, time: Array, values: Array) -> Array:
    """Return the smoothed speed at the grid times, without its mean; 0 outside the recording."""
    order = np.argsort(time, kind='stable')
    on_grid = np.column_stack([np.interp(grid, time[order], column[order]) for column in values.T])
    width = max(1, round(_SMOOTH * _RATE))
    window = np.hanning(2 * width + 1)
    window /= window.sum()
    smooth = np.column_stack([np.convolve(column, window, 'same') for column in on_grid.T])
    speed = np.linalg.norm(np.gradient(smooth, grid, axis=0), axis=1)
    speed[(grid < time.min() + 2 * _SMOOTH) | (grid > time.max() - 2 * _SMOOTH)] = 0.0
    return np.asarray(speed - speed.mean())


def _correlation(one: Array, other: Array, lags: int) -> Array:
    """Return the correlations of `one` with `other` for delays from -lags to lags samples."""
    whole = correlate(one, other, method='fft')
    middle = len(other) - 1  # without a delay
    whole = np.pad(whole, lags)
    found = whole[middle : middle + 2 * lags + 1]
    return np.asarray(found / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-300))
