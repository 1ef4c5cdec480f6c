"""Recordings resampled to a uniform time grid, with the section used for identification."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.motion_check import PeriodicPart
from aerarm_ros.identification.conditioning.spectral_filter import (
    MEMORY_PERIODS,
    SETTLING_PERIODS,
    SpectralFilter,
    harmonic_gain,
    low_pass_gain,
)
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import Array

# [rad] travel after which the state of friction that builds up over the longest distance, 0.03 rad,
# no longer depends on its start
_FORGOTTEN = 1.2


FOLDS = 5
"""Number of parts into which cross-validation divides a motion."""

BLOCKS = 5 * FOLDS
"""Number of consecutive blocks of a motion; five of them form a part for cross-validation."""


# fraction of a joint's top speed, below which the joint counts as at rest
_STANDSTILL_SPEED = 5e-3


def at_rest(dq: Array) -> npt.NDArray[np.bool_]:
    """Return a mask (M, n) of the samples in which a joint counts as at rest."""
    top = np.maximum(np.abs(dq).max(axis=0, initial=0.0), 1e-6)
    return np.asarray(np.abs(dq) < _STANDSTILL_SPEED * top, dtype=bool)


@dataclass(frozen=True, eq=False)
class Samples:
    """Conditioned motion of one bag, sampled at a fine and at a coarse rate.

    Arrays named `fine`, usually sampled at a hundred times the cut-off, keep the steps of dry
    friction in place. Arrays without `fine` in the name, sampled at five times the cut-off, are
    used for the fit.

    Attributes
    ----------
    name : str
        Name of the bag.
    recorded : int
        Number of recorded samples used.
    time : (M,) ndarray
        Time of the decimated samples [s] since the bag's start.
    q, dq, ddq : (M, n) ndarray
        Joint positions, velocities, accelerations [rad], [rad/s], [rad/s^2].
    dq_fine, ddq_fine : (L, n) ndarray
        Finely sampled velocities and accelerations [rad/s], [rad/s^2].
    tau_raw, tau : (M, n) ndarray
        Measured torque as recorded and low-pass filtered [Nm].
    fine_filter, coarse_filter : SpectralFilter
        Low-pass filter of the torque, applied to regressor columns at the fine rate (with
        decimation) and at the coarse rate. Torque and regressor thus pass the same filter.
    kept : (M,) ndarray of bool
        Samples far enough from the ends for the filter to have settled.
    measured : (M, n) ndarray of bool
        Kept samples with a valid joint torque: the effort is neither constant nor near saturation.
    usable : (M, n) ndarray of bool
        Samples used in fits: measured samples in which the joint moves.
    block : (M,) ndarray of int
        Number of the consecutive block of motion, 0 .. `BLOCKS` - 1.
    cycle : int
        Number of samples after which position, velocity and acceleration repeat exactly; M if they
        do not.
    """

    name: str
    recorded: int
    time: Array
    q: Array
    dq: Array
    ddq: Array
    dq_fine: Array
    ddq_fine: Array
    tau_raw: Array
    tau: Array
    fine_filter: SpectralFilter
    coarse_filter: SpectralFilter
    kept: npt.NDArray[np.bool_]
    measured: npt.NDArray[np.bool_]
    usable: npt.NDArray[np.bool_]
    block: npt.NDArray[np.intp]
    cycle: int

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def fold(self) -> npt.NDArray[np.intp]:
        """Cross-validation part of each sample (M,): 0 to `FOLDS` - 1, in turn from block to block.

        Every part thus covers the whole motion. With contiguous parts, the torque of a part would
        be predicted for postures that no other part reaches, which would test extrapolation.
        """
        return np.asarray(self.block % FOLDS)

    @property
    def step(self) -> int:
        """Decimation factor from fine to coarse samples."""
        return self.fine_filter.decimation

    def distinct(self) -> tuple['Samples', npt.NDArray[np.intp] | None]:
        """Return the motion without cycles that only repeat earlier cycles.

        A motion of equal cycles has equal regressor columns in all of them, except near its ends.
        Half an hour of a periodic excitation has a hundred equal cycles or more.

        Returns
        -------
        Samples
            Motion of K samples.
        (M,) ndarray of int or None
            Row in this motion of each sample of the whole motion; None if both are equal.
        """
        count, cycle = len(self.q), self.cycle
        fine, coarse = self.fine_filter, self.coarse_filter
        travel = np.abs(self.dq_fine[: cycle * self.step]).sum(axis=0).min() * fine.dt
        cycles = kept = count // cycle
        if fine.memory is not None and travel > 0.0:
            # At each end, neither the filter nor the state of friction reaches the middle cycle.
            end = np.ceil(fine.memory / (cycle * coarse.dt)) + np.ceil(_FORGOTTEN / travel)
            if 2 * (2 * end + 1) <= cycles:  # otherwise the gain is small
                kept = 2 * int(end) + 1
        left_out = count - kept * cycle
        if not left_out:
            return self, None
        first = kept // 2 * cycle  # sample at which the middle cycle begins
        rows = np.delete(np.arange(count), slice(first, first + left_out))
        fine_rows = (rows[:, None] * self.step + np.arange(self.step)).ravel()
        place = np.arange(count)
        repeated = first + (place - first) % cycle
        place[first:] = np.maximum(place - left_out, repeated)[first:]
        parts: dict[str, Any] = {name: getattr(self, name)[rows] for name in _COARSE}
        parts |= {name: getattr(self, name)[fine_rows] for name in ('dq_fine', 'ddq_fine')}
        filters = fine.for_count(len(fine_rows)), coarse.for_count(len(rows))
        return replace(self, **parts, fine_filter=filters[0], coarse_filter=filters[1]), place


_COARSE = ('time', 'q', 'dq', 'ddq', 'tau_raw', 'tau', 'kept', 'measured', 'usable', 'block')

SHORTEST = 3.0
"""Shortest motion for an identification [s]; a shorter motion hardly excites the parameters."""

# cut-off of the low-pass filter applied before decimation, relative to the new sampling rate
_ANTI_ALIASING = 0.4
# fraction of the top speed of the fastest joint, below which the arm counts as at rest
_STANDSTILL = 0.02


@dataclass(frozen=True, eq=False)
class UniformMotion:
    """Recording resampled at uniform times.

    Attributes
    ----------
    recording : Recording
        Original recording.
    dt : float
        Sampling time [s].
    time : (M,) ndarray
        Time [s] since the start of the bag.
    q, tau : (M, n) ndarray
        Joint positions [rad] and torques [Nm].
    dq : (M, n) ndarray or None
        Measured velocity [rad/s].
    tau_raw : (M, n) ndarray
        Torque without filter, only interpolated [Nm].
    factor : int
        Number of recorded samples per uniform sample; if above 1, q, dq and tau were low-pass
        filtered.
    window : slice
        Samples used for identification: whole periods, or from first to last motion.
    period : int or None
        Number of samples per period if the window consists of whole periods.
    """

    recording: Recording
    dt: float
    time: Array
    q: Array
    tau: Array
    dq: Array | None
    tau_raw: Array
    factor: int
    window: slice
    period: int | None

    @property
    def periods(self) -> int:
        """Number of whole periods in the window, 0 if the motion is not periodic."""
        return self.count // self.period if self.period else 0

    @property
    def count(self) -> int:
        """Number of samples in the window."""
        return int(self.window.stop - self.window.start)

    def with_velocity_earlier(self, delay: Array) -> 'UniformMotion':
        """Return the motion with measured velocities shifted to earlier times by `delay`."""
        if self.dq is None:
            return self
        columns = zip(delay, self.dq.T, strict=True)
        dq = [np.interp(self.time + d, self.time, column) for d, column in columns]
        return replace(self, dq=np.column_stack(dq))


def sampling_time(recording: Recording) -> float:
    """Return the typical time between two samples [s].

    The result is the mean time between samples, unless lost messages increase the mean. Single
    differences would be inaccurate, because stamps since 1970 are rounded to 0.2 us.
    """
    median = float(np.median(np.diff(recording.time)))
    mean = recording.duration / (len(recording.time) - 1)
    return mean if abs(mean - median) < 1e-3 * median else median


def periodic_motion(
    recording: Recording,
    part: PeriodicPart,
    multiple: int = 1,
    factor: int = 1,
    effort_delay: Array | None = None,
) -> UniformMotion:
    """Resample a periodic motion to a whole number of samples per period.

    Parameters
    ----------
    part : PeriodicPart
        Whole periods of the recording.
    multiple : int
        Required divisor of the number of samples per period (for further decimation).
    factor : int
        Decimation factor.
    effort_delay : (n,) ndarray, optional
        Delay of the efforts [s], which is corrected.
    """
    whole = multiple * factor
    count = max(1, round(part.period / (sampling_time(recording) * whole))) * whole
    dt = part.period / count
    before = int((part.start - recording.time[0]) / dt + 1e-9) // factor * factor
    after = int((recording.time[-1] - part.start) / dt + 1e-9)
    # The last sample of the last period may coincide with the first sample.
    after = max(after, part.periods * count - 1)
    time = part.start + dt * np.arange(-before, after + 1)
    first = before // factor
    window = slice(first, first + part.periods * count // factor)
    motion = (np.asarray(time), dt, factor, window, count // factor)
    return _resampled(recording, *motion, effort_delay)


def aperiodic_motion(
    recording: Recording,
    factor: int = 1,
    shortest: float = SHORTEST,
    effort_delay: Array | None = None,
) -> UniformMotion:
    """Resample an aperiodic motion to uniform times, without the standstill at both ends.

    Parameters
    ----------
    factor : int
        Decimation factor.
    shortest : float
        Shortest accepted motion [s].
    effort_delay : (n,) ndarray, optional
        Delay of the efforts [s], which is corrected.

    Raises
    ------
    IdentificationError
        If the motion is shorter than `shortest`.
    """
    dt = sampling_time(recording)
    time = recording.time[0] + dt * np.arange(int(recording.duration / dt + 1e-6) + 1)
    motion = _resampled(recording, time, dt, factor, slice(0, None), None, effort_delay)
    dq = motion.dq if motion.dq is not None else np.gradient(motion.q, motion.dt, axis=0)
    speed = np.abs(dq).max(axis=1)
    moving = np.flatnonzero(speed > _STANDSTILL * speed.max())
    window = slice(int(moving[0]), int(moving[-1]) + 1)
    duration = (window.stop - window.start) * motion.dt
    if duration < shortest:
        what_for, better = 'be filtered', ''
        if shortest == SHORTEST:
            what_for, better = 'excite all parameters', ' (better 20 s)'
        raise IdentificationError(
            f'{recording.name} contains only {duration:.2f} s of motion, too short to '
            f'{what_for}: record at least {shortest:.2g} s{better}'
        )
    return replace(motion, window=window)


def _resampled(
    recording: Recording,
    time: Array,
    dt: float,
    factor: int,
    window: slice,
    period: int | None,
    effort_delay: Array | None,
) -> UniformMotion:
    """Interpolate and decimate a recording; works joint by joint to save memory."""
    late = np.zeros(recording.tau.shape[1]) if effort_delay is None else effort_delay
    cutoff = _ANTI_ALIASING / (dt * factor)
    settling = SETTLING_PERIODS / cutoff
    smooth = SpectralFilter(
        len(time), dt, low_pass_gain(cutoff), factor, settling, MEMORY_PERIODS / cutoff
    )

    def at(instants: Array, values: Array, delay: Array) -> Iterator[Array]:
        for d, column in zip(delay, values.T, strict=True):
            yield np.interp(instants + d if d else instants, recording.time, column)

    def filtered(values: Array, delay: Array) -> Array:
        columns = at(time, values, delay)
        return np.column_stack([smooth(c) if factor > 1 else c for c in columns])

    in_time, thinned = np.zeros_like(late), time[::factor]
    return UniformMotion(
        recording=recording,
        dt=dt * factor,
        time=thinned,
        q=filtered(recording.q, in_time),
        tau=filtered(recording.tau, late),
        dq=None if recording.dq is None else filtered(recording.dq, in_time),
        tau_raw=np.column_stack(list(at(thinned, recording.tau, late))),
        factor=factor,
        window=window,
        period=period,
    )


@dataclass(frozen=True)
class KinematicsFilter:
    """Filter of positions, velocities and accelerations, and source of the velocities.

    Attributes
    ----------
    cutoff : float
        Cut-off of the zero-phase low-pass filter [Hz].
    harmonics : int or None
        If set, pass only the constant and this many harmonics of whole periods (rectangular windows
        in the frequency domain); None for the low-pass filter.
    from_position : bool
        Whether positions are differentiated (once and twice) in place of measured velocities.
    in_time : bool
        Whether the delay of measured velocities was corrected.
    """

    cutoff: float
    harmonics: int | None = None
    from_position: bool = False
    in_time: bool = False

    @property
    def label(self) -> str:
        """Short description of the filter, for reports."""
        if self.harmonics is None:
            return f'zero-phase Butterworth at {self.cutoff:.3g} Hz, {self.source}'
        return f'rectangular windows at {self.harmonics} harmonics, {self.source}'

    @property
    def source(self) -> str:
        """Description of the source of the velocities, for reports."""
        if self.from_position:
            return 'differentiated positions'
        return 'measured velocities' + (', delay compensated' if self.in_time else '')

    def apply(self, motion: UniformMotion) -> tuple[Array, Array, Array]:
        """Return filtered positions, velocities and accelerations in the motion's window.

        Parameters
        ----------
        motion : UniformMotion
            Motion whose window consists of whole periods if `harmonics` is set.

        Returns
        -------
        three (M, n) ndarrays
            Positions [rad], velocities [rad/s] and accelerations [rad/s^2] at the full sampling
            rate. The acceleration is the derivative of the filtered velocity, thesis section
            3.5.1.
        """
        if self.harmonics is not None and motion.period is not None:
            # Every harmonic of the period has the same phase in all periods, so the filter of the
            # mean period is that of the whole motion.
            shape = (motion.periods, motion.period, motion.q.shape[1])
            gain = harmonic_gain(1.0 / (motion.period * motion.dt), self.harmonics)
            smooth = SpectralFilter(motion.period, motion.dt, gain)
            parts = self._filtered(
                smooth,
                motion.q[motion.window].reshape(shape).mean(axis=0),
                None if motion.dq is None else motion.dq[motion.window].reshape(shape).mean(axis=0),
            )
            q, dq, ddq = (np.tile(own, (motion.periods, 1)) for own in parts)
            return q, dq, ddq
        # The whole recording is filtered, so that the samples at the window's ends have recorded
        # neighbours.
        smooth = SpectralFilter(
            *(len(motion.time), motion.dt, low_pass_gain(self.cutoff)),
            settling=SETTLING_PERIODS / self.cutoff,
            memory=MEMORY_PERIODS / self.cutoff,
        )
        q, dq, ddq = (own[motion.window] for own in self._filtered(smooth, motion.q, motion.dq))
        return q, dq, ddq

    def repeats(self, motion: UniformMotion) -> bool:
        """Return whether the motion is exactly periodic after the filter."""
        return self.harmonics is not None and motion.period is not None

    def _filtered(
        self, smooth: SpectralFilter, q: Array, dq: Array | None
    ) -> tuple[Array, Array, Array]:
        if self.from_position or dq is None:
            return smooth(q), smooth(q, derivative=1), smooth(q, derivative=2)
        return smooth(q), smooth(dq), smooth(dq, derivative=1)
