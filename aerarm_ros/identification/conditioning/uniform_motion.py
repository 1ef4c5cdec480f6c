"""A recording on a uniform time grid, with the stretch that identification uses."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.periodicity import PeriodicPart
from aerarm_ros.identification.conditioning.spectral_filter import (
    SETTLING_PERIODS,
    SpectralFilter,
    low_pass_gain,
)
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import Recording

Array = npt.NDArray[np.float64]

SHORTEST = 3.0
"""Motion [s] to identify from: a shorter one excites next to nothing."""

_ANTI_ALIASING = 0.4  # cut-off of the low-pass before decimation, per new sampling rate
_STANDSTILL = 0.02  # share of the fastest joint's top speed


@dataclass(frozen=True, eq=False)
class UniformMotion:
    """Uniform samples of a recording.

    Attributes
    ----------
    recording : Recording
        Where they come from.
    dt : float
        Sampling time [s].
    time : (M,) ndarray
        [s] since the recording's start.
    q, tau : (M, n) ndarray
        [rad], [Nm]
    dq : (M, n) ndarray or None
        Measured velocity [rad/s].
    tau_raw : (M, n) ndarray
        [Nm], interpolated only.
    factor : int
        Recorded samples for each one here; beyond 1, q, dq and tau have passed a low-pass.
    window : slice
        The samples to identify from: whole periods, or from first to last motion.
    period : int or None
        Samples a period if the window consists of whole periods.
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
        """Number of whole periods in the window, 0 if it isn't periodic."""
        return self.count // self.period if self.period else 0

    @property
    def count(self) -> int:
        """Number of samples in the window."""
        return int(self.window.stop - self.window.start)

    def with_velocity_earlier(self, delay: Array) -> 'UniformMotion':
        """Return the same motion for measured velocities that are late by (n,) [s]."""
        if self.dq is None:
            return self
        columns = zip(delay, self.dq.T, strict=True)
        dq = [np.interp(self.time + d, self.time, column) for d, column in columns]
        return replace(self, dq=np.column_stack(dq))


def sampling_time(recording: Recording) -> float:
    """Return the usual time between two samples [s].

    The mean, unless lost messages make it larger: single differences of stamps since 1970
    are rounded to 0.2 us.
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
    """Resample so that a period has a whole number of samples.

    Parameters
    ----------
    recording : Recording
    part : PeriodicPart
        The whole periods in it.
    multiple : int
        Number that divides the samples a period (for further decimation).
    factor : int
        Of decimation.
    effort_delay : (n,) ndarray, optional
        By which efforts are late [s]: they are moved to where they belong.
    """
    whole = multiple * factor
    count = max(1, round(part.period / (sampling_time(recording) * whole))) * whole
    dt = part.period / count
    before = int((part.start - recording.time[0]) / dt + 1e-9) // factor * factor
    after = int((recording.time[-1] - part.start) / dt + 1e-9)
    # The last sample of the last period may be the first one again.
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
    """Resample at the recorded rate, decimated; leave out standing still at both ends.

    Parameters
    ----------
    recording : Recording
    factor : int
        Of decimation.
    shortest : float
        Least motion [s].
    effort_delay : (n,) ndarray, optional
        By which efforts are late [s]: they are moved to where they belong.

    Raises
    ------
    IdentificationError
        If the motion is shorter.
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
        what_for, better = (
            ('excite the parameters', ' (better 20 s)')
            if shortest == SHORTEST
            else ('be filtered', '')
        )
        raise IdentificationError(
            f'{recording.name}: only {duration:.2f} s of motion: too '
            f'short to {what_for}, record at least {shortest:.2g} s{better}'
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
    """Interpolate and decimate, a column at a time: long recordings are large."""
    late = np.zeros(recording.tau.shape[1]) if effort_delay is None else effort_delay
    cutoff = _ANTI_ALIASING / (dt * factor)
    settling = SETTLING_PERIODS / cutoff
    smooth = SpectralFilter(len(time), dt, low_pass_gain(cutoff), factor, settling)

    def at(values: Array, delay: Array | None = None) -> Array:
        behind = np.zeros(values.shape[1]) if delay is None else delay
        columns = (
            np.interp(time + d if d else time, recording.time, column)
            for d, column in zip(behind, values.T, strict=True)
        )
        return np.column_stack([smooth(c) if factor > 1 else c for c in columns])

    thinned = time[::factor]
    raw = [
        np.interp(thinned + d, recording.time, column)
        for d, column in zip(late, recording.tau.T, strict=True)
    ]
    return UniformMotion(
        recording=recording,
        dt=dt * factor,
        time=thinned,
        q=at(recording.q),
        tau=at(recording.tau, late),
        dq=None if recording.dq is None else at(recording.dq),
        tau_raw=np.column_stack(raw),
        factor=factor,
        window=window,
        period=period,
    )
