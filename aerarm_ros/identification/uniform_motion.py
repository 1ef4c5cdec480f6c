"""A recording on a uniform time grid, with the stretch that identification uses."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.periodicity import PeriodicPart
from aerarm_ros.identification.recording import Recording

Array = npt.NDArray[np.float64]

_SHORTEST = 3.0  # [s] of motion: a shorter one excites next to nothing
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


def sampling_time(recording: Recording) -> float:
    """Return the usual time between two samples [s].

    The mean, unless lost messages make it larger: single differences of stamps since 1970
    are rounded to 0.2 us.
    """
    median = float(np.median(np.diff(recording.time)))
    mean = recording.duration / (len(recording.time) - 1)
    return mean if abs(mean - median) < 1e-3 * median else median


def periodic_motion(recording: Recording, part: PeriodicPart, multiple: int) -> UniformMotion:
    """Resample so that a period has a whole number of samples.

    Parameters
    ----------
    recording : Recording
    part : PeriodicPart
        The whole periods in it.
    multiple : int
        Number that divides the samples a period (for decimation).
    """
    count = max(1, round(part.period / (sampling_time(recording) * multiple))) * multiple
    dt = part.period / count
    before = int((part.start - recording.time[0]) / dt + 1e-9)
    after = int((recording.time[-1] - part.start) / dt + 1e-9)
    time = part.start + dt * np.arange(-before, after + 1)
    window = slice(before, before + part.periods * count)
    if window.stop > len(time):  # the last sample of the last period is the first one again
        time = part.start + dt * np.arange(-before, part.periods * count)
    return _resampled(recording, np.asarray(time, dtype=float), dt, window, count)


def aperiodic_motion(recording: Recording) -> UniformMotion:
    """Resample at the recorded rate; leave out standing still at both ends.

    Raises
    ------
    IdentificationError
        If the motion is shorter than 3 s.
    """
    dt = sampling_time(recording)
    time = recording.time[0] + dt * np.arange(int(recording.duration / dt + 1e-6) + 1)
    motion = _resampled(recording, time, dt, slice(0, len(time)), None)
    dq = motion.dq if motion.dq is not None else np.gradient(motion.q, dt, axis=0)
    speed = np.abs(dq).max(axis=1)
    moving = np.flatnonzero(speed > _STANDSTILL * speed.max())
    window = slice(int(moving[0]), int(moving[-1]) + 1)
    if (window.stop - window.start) * dt < _SHORTEST:
        raise IdentificationError(
            f'{recording.name}: only {(window.stop - window.start) * dt:.2f} s of motion: too '
            f'short to excite the parameters, record at least {_SHORTEST:g} s (better 20 s)'
        )
    return UniformMotion(recording, dt, motion.time, motion.q, motion.tau, motion.dq, window, None)


def _resampled(
    recording: Recording, time: Array, dt: float, window: slice, period: int | None
) -> UniformMotion:
    def at(values: Array) -> Array:
        return np.column_stack([np.interp(time, recording.time, column) for column in values.T])

    dq = None if recording.dq is None else at(recording.dq)
    return UniformMotion(
        recording, dt, time, at(recording.q), at(recording.tau), dq, window, period
    )
