"""From recordings to samples: windows, filters and rates, thesis section 3.5."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.conditioning_options import ConditioningOptions
from aerarm_ros.identification.conditioning.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.conditioning.motion_band import motion_band
from aerarm_ros.identification.conditioning.motion_check import (
    aperiodic_warnings,
    fundamental_warnings,
    harmonics_warnings,
    short_motion_warnings,
)
from aerarm_ros.identification.conditioning.periodicity import (
    PeriodicPart,
    count_harmonics,
    find_periodic_part,
)
from aerarm_ros.identification.conditioning.samples import Samples
from aerarm_ros.identification.conditioning.spectral_filter import (
    SETTLING_PERIODS,
    SpectralFilter,
    low_pass_gain,
)
from aerarm_ros.identification.conditioning.uniform_motion import (
    UniformMotion,
    aperiodic_motion,
    periodic_motion,
    sampling_time,
)
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import Recording

Array = npt.NDArray[np.float64]

# Gautier (ICRA 1997): a low-pass ten times above the motion leaves its dynamics alone.
_CUTOFF_PER_BAND = 10.0
_CUTOFF_MIN_PER_BAND = 0.5  # below, most of the motion is lost
# ... but there must be enough samples in a period of the cut-off to differentiate.
_SAMPLES_PER_CUTOFF = 10.0
# The filtered torque is kept at five times the cut-off: above the Nyquist rate, 2, with room
# for the filter's slope.
_RATE_PER_CUTOFF = 5.0
# Before, signals are kept at this many times the cut-off: the steps of dry friction are then off
# by half a hundredth of the cut-off's period at most, and the filter removes what is faster.
_FINE_RATE_PER_CUTOFF = 100.0
_FINE_RATE_MIN = 400.0  # [Hz]; the motion doesn't slow down with the cut-off
_SEARCH_RATE = 250.0  # [Hz] is enough to find band and harmonics of any arm's motion
_EDGE = 0.5  # periods of the cut-off left out at the ends of a motion that isn't periodic
_SPREAD = 1.0  # periods of the cut-off to either side, over which it spreads saturated torque
_STANDSTILL_SPEED = 5e-3  # share of a joint's top speed
_STANDSTILL_TIME = 0.3  # [s]
FOLDS = 5


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
    warnings : list of str
        What of the options doesn't fit the motion, and motions that are short.

    Raises
    ------
    IdentificationError
        If a recording is too short, or the cut-off, the harmonics or the filter don't fit it.
    """

    def __init__(self, recordings: Sequence[Recording], options: ConditioningOptions) -> None:
        self._options = options
        self._parts: dict[Recording, PeriodicPart | None] = {}
        self._motions: dict[tuple[Recording, int], UniformMotion] = {}
        motions = [self._motion(r, 1, _factor(r, _SEARCH_RATE)) for r in recordings]
        velocities = [_rough_velocity(motion) for motion in motions]
        self.harmonics: int | None = None
        self.fundamental: float | None = None
        self.warnings = [text for motion in motions for text in short_motion_warnings(motion)]
        if options.fundamental is not None:
            for motion in motions:
                needed = options.filter == 'harmonics'
                self.warnings += fundamental_warnings(motion, options.fundamental, needed)
        if all(motion.period for motion in motions):
            found = max(
                count_harmonics(dq, motion.periods)
                for dq, motion in zip(velocities, motions, strict=True)
            )
            self.fundamental = 1.0 / ((motions[0].period or 1) * motions[0].dt)
            if options.harmonics is not None:
                rate = min(1.0 / sampling_time(recording) for recording in recordings)
                self.warnings += harmonics_warnings(
                    options.harmonics, found, self.fundamental, rate
                )
            self.harmonics = options.harmonics or found
            band = self.harmonics * self.fundamental
        else:
            self.warnings += aperiodic_warnings(motions, options)
            band = max(
                motion_band(dq, motion.dt) for dq, motion in zip(velocities, motions, strict=True)
            )
        self.band = band
        self.cutoff = self._choose_cutoff(band, max(map(sampling_time, recordings)))

    def candidates(self) -> list[KinematicsFilter]:
        """Return the kinematics filters to choose from, the simplest first."""
        wanted = self._options.filter
        filters = [KinematicsFilter(self.cutoff)]
        if self.harmonics is not None and self.fundamental is not None and wanted != 'butterworth':
            known = KinematicsFilter(self.cutoff, self.harmonics)
            below_cutoff = max(self.harmonics, int(self.cutoff / self.fundamental))
            all_below = KinematicsFilter(self.cutoff, below_cutoff)
            filters = [known] if wanted == 'harmonics' else [known, all_below, *filters]
        return [
            replace(f, from_position=source)
            for source in (False, True)
            for f in dict.fromkeys(filters)
        ]

    def condition(self, recording: Recording, kinematics: KinematicsFilter) -> Samples:
        """Filter one bag.

        Raises
        ------
        IdentificationError
            If the motion in it is too short.
        """
        factor = _factor(recording, max(_FINE_RATE_PER_CUTOFF * self.cutoff, _FINE_RATE_MIN))
        step = _factor(recording, _RATE_PER_CUTOFF * self.cutoff * factor)
        return self._samples(self._motion(recording, step, factor), kinematics, step)

    def forget_motions(self) -> None:
        """Free what is kept of recordings between one filter and the next."""
        self._motions.clear()

    def _motion(self, recording: Recording, multiple: int, factor: int) -> UniformMotion:
        """Return the motion with a whole number of decimated samples a period; found once."""
        if recording not in self._parts:
            fundamental = self._options.fundamental
            self._parts[recording] = find_periodic_part(recording.time, recording.q, fundamental)
        part = self._parts[recording]
        known = self._motions.get((recording, factor))
        if known is None or (known.period or 0) % multiple:
            known = (
                aperiodic_motion(recording, factor)
                if part is None
                else periodic_motion(recording, part, multiple, factor)
            )
            self._motions[recording, factor] = known
        return known

    def _choose_cutoff(self, band: float, dt: float) -> float:
        limit = 0.4 / dt
        if self._options.cutoff is not None:
            if self._options.cutoff > limit:
                raise IdentificationError(
                    f'cut-off {self._options.cutoff:g} Hz is above {limit:.3g} Hz, which is what '
                    f"the bag's rate of {1.0 / dt:.3g} Hz allows: choose a lower one"
                )
            if self._options.cutoff < _CUTOFF_MIN_PER_BAND * band:
                raise IdentificationError(
                    f'cut-off {self._options.cutoff:g} Hz would filter the motion away, which '
                    f'reaches {band:.3g} Hz: choose a higher one'
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
        tau = motion.tau[motion.window]
        kept = self._kept(motion, len(time), motion.dt * step)
        still = _standing_still(dq[::step], motion.dt * step)
        recording = motion.recording
        measured = kept[:, None] & ~recording.dead_effort
        if recording.saturated is not None:
            measured &= ~_near(recording, recording.saturated, time, _SPREAD / self.cutoff)
        return Samples(
            name=recording.name,
            recorded=motion.count * motion.factor,
            time=time,
            q=q[::step].copy(),  # a view would keep the fine positions, which nobody needs
            dq=dq[::step],
            ddq=ddq[::step],
            dq_fine=dq,
            ddq_fine=ddq,
            tau_raw=motion.tau_raw[motion.window][::step],
            tau=fine(tau),
            fine_filter=fine,
            coarse_filter=coarse,
            kept=kept,
            measured=measured,
            usable=measured & ~still,
            fold=_folds(motion, len(time), step),
        )

    def _kept(self, motion: UniformMotion, count: int, dt: float) -> npt.NDArray[np.bool_]:
        kept = np.ones(count, dtype=bool)
        edge = 0 if motion.period else int(np.ceil(_EDGE / (self.cutoff * dt)))
        if edge:
            kept[:edge] = kept[-edge:] = False
        return kept


def _factor(recording: Recording, rate: float) -> int:
    """Return how many recorded samples go into one at no less than a rate [Hz]."""
    # Stamps jitter: a ratio just below a whole number is meant to be one.
    return max(1, int(1.0 / (sampling_time(recording) * rate) + 1e-3))


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


def _near(
    recording: Recording, flags: npt.NDArray[np.bool_], time: Array, distance: float
) -> npt.NDArray[np.bool_]:
    """Return which instants (K,) lie within a distance [s] of flagged samples; (K, n)."""
    near = np.zeros((len(time), flags.shape[1]), dtype=bool)
    for joint in range(flags.shape[1]):
        flagged = recording.time[flags[:, joint]]
        first = np.searchsorted(flagged, time - distance)
        near[:, joint] = first < np.searchsorted(flagged, time + distance, side='right')
    return near


def _folds(motion: UniformMotion, count: int, step: int) -> npt.NDArray[np.intp]:
    """Return consecutive parts of the motion; a periodic motion's repetitions go together."""
    length = motion.period // step if motion.period else count
    return np.asarray((np.arange(count) % length) * FOLDS // length, dtype=np.intp)
