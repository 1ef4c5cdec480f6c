"""From recordings to samples: windows, filters and rates, thesis section 3.5."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.motion_band import motion_band
from aerarm_ros.identification.periodicity import (
    PeriodicPart,
    count_harmonics,
    find_periodic_part,
)
from aerarm_ros.identification.recording import Recording
from aerarm_ros.identification.samples import Samples
from aerarm_ros.identification.spectral_filter import (
    SETTLING_PERIODS,
    SpectralFilter,
    low_pass_gain,
)
from aerarm_ros.identification.uniform_motion import (
    UniformMotion,
    aperiodic_motion,
    periodic_motion,
    sampling_time,
)

Array = npt.NDArray[np.float64]

# Gautier (ICRA 1997): a low-pass ten times above the motion leaves its dynamics alone.
_CUTOFF_PER_BAND = 10.0
# ... but there must be enough samples in a period of the cut-off to differentiate.
_SAMPLES_PER_CUTOFF = 10.0
# The filtered torque is kept at five times the cut-off: above the Nyquist rate, 2, with room
# for the filter's slope.
_RATE_PER_CUTOFF = 5.0
_EDGE = 0.5  # periods of the cut-off left out at the ends of a motion that isn't periodic
_STANDSTILL_SPEED = 5e-3  # share of a joint's top speed
_STANDSTILL_TIME = 0.3  # [s]
FOLDS = 5


@dataclass(frozen=True)
class ConditioningOptions:
    """What the user may fix; None is found from the data.

    Attributes
    ----------
    fundamental : float or None
        f0 [Hz] of the excitation.
    harmonics : int or None
        N of the excitation.
    cutoff : float or None
        Of the low-pass on torque [Hz].
    """

    fundamental: float | None = None
    harmonics: int | None = None
    cutoff: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ('fundamental', 'cutoff'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise IdentificationError(f'{name} = {value} must be a positive frequency [Hz]')
        if self.harmonics is not None and self.harmonics < 1:
            raise IdentificationError(f'harmonics = {self.harmonics} must be at least 1')


class Conditioner:
    """Finds cut-off and harmonics on the identification bags, and conditions any bag with them.

    Parameters
    ----------
    recordings : sequence of Recording
        The bags to identify from: nothing is learnt from a validation bag.
    options : ConditioningOptions
        What is already known.

    Attributes
    ----------
    cutoff : float
        Of the torque's low-pass [Hz].
    harmonics : int or None
        N of the excitation; None if a bag isn't periodic.
    fundamental : float or None
        f0 [Hz] of the first bag; None if a bag isn't periodic.
    band : float
        Frequency [Hz] below which the motion lies.

    Raises
    ------
    IdentificationError
        If a recording is too short, or the cut-off doesn't fit the sampling rate.
    """

    def __init__(self, recordings: Sequence[Recording], options: ConditioningOptions) -> None:
        self._options = options
        self._parts: dict[Recording, PeriodicPart | None] = {}
        self._motions: dict[tuple[Recording, int], UniformMotion] = {}
        motions = [self._motion(recording, 1) for recording in recordings]
        velocities = [_rough_velocity(motion) for motion in motions]
        self.harmonics: int | None = None
        self.fundamental: float | None = None
        if all(motion.period for motion in motions):
            self.harmonics = options.harmonics or max(
                count_harmonics(dq, motion.periods)
                for dq, motion in zip(velocities, motions, strict=True)
            )
            self.fundamental = 1.0 / ((motions[0].period or 1) * motions[0].dt)
            band = self.harmonics * self.fundamental
        else:
            band = max(
                motion_band(dq, motion.dt) for dq, motion in zip(velocities, motions, strict=True)
            )
        self.band = band
        self.cutoff = self._choose_cutoff(band, max(motion.dt for motion in motions))
        self._motions.clear()  # from now on with samples that fit the decimation

    def candidates(self) -> list[KinematicsFilter]:
        """Return the kinematics filters to choose from, the simplest first."""
        filters = [KinematicsFilter(self.cutoff)]
        if self.harmonics is not None and self.fundamental is not None:
            below_cutoff = max(self.harmonics, int(self.cutoff / self.fundamental))
            counts = (self.harmonics, below_cutoff)
            filters = [
                KinematicsFilter(self.cutoff, count) for count in dict.fromkeys(counts)
            ] + filters
        return [replace(f, from_position=source) for source in (False, True) for f in filters]

    def condition(self, recording: Recording, kinematics: KinematicsFilter) -> Samples:
        """Filter one bag.

        Raises
        ------
        IdentificationError
            If the motion in it is too short.
        """
        rate = 1.0 / sampling_time(recording)
        # Stamps jitter: a ratio just below a whole number is meant to be one.
        step = max(1, int(rate / (_RATE_PER_CUTOFF * self.cutoff) + 1e-3))
        return self._samples(self._motion(recording, step), kinematics, step)

    def _motion(self, recording: Recording, multiple: int) -> UniformMotion:
        """Return the motion with a whole number of decimated samples a period; found once."""
        if recording not in self._parts:
            fundamental = self._options.fundamental
            self._parts[recording] = find_periodic_part(recording.time, recording.q, fundamental)
        part = self._parts[recording]
        key = (recording, multiple)
        if key not in self._motions:
            self._motions[key] = (
                aperiodic_motion(recording)
                if part is None
                else periodic_motion(recording, part, multiple)
            )
        return self._motions[key]

    def _choose_cutoff(self, band: float, dt: float) -> float:
        limit = 0.4 / dt
        if self._options.cutoff is not None:
            if self._options.cutoff > limit:
                raise IdentificationError(
                    f'cut-off {self._options.cutoff:g} Hz is above {limit:.3g} Hz, which is what '
                    f"the bag's rate of {1.0 / dt:.3g} Hz allows: choose a lower one"
                )
            return self._options.cutoff
        return min(_CUTOFF_PER_BAND * band, 1.0 / (_SAMPLES_PER_CUTOFF * dt))

    def _samples(self, motion: UniformMotion, kinematics: KinematicsFilter, step: int) -> Samples:
        q, dq, ddq = kinematics.apply(motion)
        gain = low_pass_gain(self.cutoff)
        settling = None if motion.period else SETTLING_PERIODS / self.cutoff
        fine = SpectralFilter(motion.count, motion.dt, gain, step, settling)
        time = motion.time[motion.window][::step]
        coarse = SpectralFilter(len(time), motion.dt * step, gain, 1, settling)
        raw = motion.tau[motion.window]
        kept = self._kept(motion, len(time), motion.dt * step)
        still = _standing_still(dq[::step], motion.dt * step)
        recording = motion.recording
        return Samples(
            name=recording.name,
            recorded=motion.count,
            time=time,
            q=q[::step],
            dq=dq[::step],
            ddq=ddq[::step],
            dq_fine=dq,
            ddq_fine=ddq,
            tau_raw=raw[::step],
            tau=fine(raw),
            fine_filter=fine,
            coarse_filter=coarse,
            kept=kept,
            usable=kept[:, None] & ~still & ~recording.dead_effort,
            fold=_folds(motion, len(time), step),
        )

    def _kept(self, motion: UniformMotion, count: int, dt: float) -> npt.NDArray[np.bool_]:
        kept = np.ones(count, dtype=bool)
        edge = 0 if motion.period else int(np.ceil(_EDGE / (self.cutoff * dt)))
        if edge:
            kept[:edge] = kept[-edge:] = False
        return kept


def _rough_velocity(motion: UniformMotion) -> Array:
    dq = motion.dq if motion.dq is not None else np.gradient(motion.q, motion.dt, axis=0)
    return np.asarray(dq[motion.window])


def _standing_still(dq: Array, dt: float) -> npt.NDArray[np.bool_]:
    """Return where a joint rests: dry friction then has any value up to its largest."""
    slow = np.abs(dq) < _STANDSTILL_SPEED * np.maximum(np.abs(dq).max(axis=0), 1e-6)
    shortest = max(2, round(_STANDSTILL_TIME / dt))
    still = np.zeros_like(slow)
    for joint in range(dq.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], slow[:, joint].astype(int), [0]))))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            still[first:last, joint] = last - first >= shortest
    return np.asarray(still, dtype=bool)


def _folds(motion: UniformMotion, count: int, step: int) -> npt.NDArray[np.intp]:
    """Return consecutive parts of the motion; a periodic motion's repetitions go together."""
    length = motion.period // step if motion.period else count
    return np.asarray((np.arange(count) % length) * FOLDS // length, dtype=np.intp)
