"""From recordings to samples: windows, filters and rates, thesis section 3.5."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from aerarm_ros.identification.conditioning.motion_check import (
    ConditioningOptions,
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
from aerarm_ros.identification.conditioning.spectral_filter import (
    SETTLING_PERIODS,
    SpectralFilter,
    low_pass_gain,
)
from aerarm_ros.identification.conditioning.uniform_motion import (
    BLOCKS,
    SHORTEST,
    KinematicsFilter,
    Samples,
    UniformMotion,
    aperiodic_motion,
    periodic_motion,
    sampling_time,
)
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class SignalDelays:
    """Delays against the positions of the same message, which are the reference of time.

    Attributes
    ----------
    velocity, effort : (n,) ndarray
        [s], positive where the signal is late.
    """

    velocity: Array
    effort: Array

    @classmethod
    def none(cls, n: int) -> 'SignalDelays':
        """Return delays of zero for n joints."""
        return cls(np.zeros(n), np.zeros(n))


# Below it a lag costs less than it is sure of: a twentieth of a period at 25 Hz.
_LEAST = 2e-3  # [s]
_CLEAR = 3.0  # standard deviations
_CORRELATION = 0.5  # periods of the cut-off that one independent sample takes


def velocity_lag(motions: Sequence[UniformMotion], cutoff: float) -> Array:
    """Return by how much measured velocities come later than the positions' derivative.

    Both through the same low-pass: a velocity that is late by e is the derivative less e times the
    acceleration, so least squares tell e, without any model of the arm.

    Parameters
    ----------
    motions : sequence of UniformMotion
        Of one arm.
    cutoff : float
        Of the low-pass [Hz].

    Returns
    -------
    (n,) ndarray
        [s]; 0 where velocities were not measured, or the lag is too small to matter or to tell.
    """
    n = motions[0].q.shape[1]
    if any(motion.dq is None for motion in motions):
        return np.zeros(n)
    products, squares, left, duration = (np.zeros(n) for _ in range(4))
    for motion in motions:
        _, derivative, ddq = KinematicsFilter(cutoff, from_position=True).apply(motion)
        _, measured, _ = KinematicsFilter(cutoff).apply(motion)
        difference = derivative - measured
        products += (difference * ddq).sum(axis=0)
        squares += (ddq**2).sum(axis=0)
        left += (difference**2).sum(axis=0)
        duration += motion.count * motion.dt
    lag = products / np.maximum(squares, 1e-300)
    left = np.maximum(left - lag * products, 0.0)
    independent = np.maximum(duration * cutoff / _CORRELATION, 1.0)
    deviation = np.sqrt(left / independent / np.maximum(squares, 1e-300))
    return np.where((np.abs(lag) < _LEAST) | (np.abs(lag) < _CLEAR * deviation), 0.0, lag)


# Bins of the spectrum that are averaged, and the least squared coherence of a motion. Independent
# noise exceeds it with a probability of 1e-6: 1 - 1e-6^(1 / (bins - 1)).
_COHERENCE_BINS = 17
_COHERENCE = 0.58
_SHARE = 0.999  # of a velocity's power lies below its band's edge


def motion_band(q: Array, dq: Array | None, dt: float) -> float:
    """Return the frequency below which nearly all of a motion lies.

    Parameters
    ----------
    q : (M, n) ndarray
        Joint positions [rad].
    dq : (M, n) ndarray or None
        Measured joint velocities [rad/s]. A joint's motion is in both, noise in one of them: the
        narrower band of the two counts, where both have the same content.
    dt : float
        Sampling time [s].

    Returns
    -------
    float
        [Hz]; the largest of the joints'. White measurement noise is taken off first, at the
        level of the upper half of the spectrum.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    edges = _edges(frequency, q, derivative=1)
    if dq is not None:
        common = _coherent(q, dq)
        for own in (None, common):
            edges = np.minimum(edges, _edges(frequency, dq, common=own))
        edges = np.minimum(edges, _edges(frequency, q, derivative=1, common=common))
    return float(max(np.max(edges, initial=0.0), frequency[1]))


def position_band(q: Array, dt: float) -> float:
    """Return the frequency [Hz] below which nearly all of the power of positions (M, n) lies.

    Lower than the motion's, since velocity and acceleration grow with frequency, but far above
    noise: no joint moves as little as its encoder's noise.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    return float(max(np.max(_edges(frequency, q), initial=0.0), frequency[1]))


def _spectrum(values: Array) -> npt.NDArray[np.complex128]:
    window = np.hanning(len(values))[:, None]
    return np.asarray(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0))


def _coherent(q: Array, dq: Array) -> npt.NDArray[np.bool_]:
    """Return at which frequencies positions and velocities show the same motion, (K, n).

    Noise of a filtered velocity falls with frequency, as a motion does. The positions do not have
    it, so its coherence with them is low. A lag of the velocity does not change the coherence.
    """
    velocities = _spectrum(dq)
    derivative = _spectrum(q) * np.arange(len(velocities))[:, None]

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter1d(values, _COHERENCE_BINS, axis=0, mode='nearest'))

    cross = derivative * np.conj(velocities)
    norm = mean(np.abs(derivative) ** 2) * mean(np.abs(velocities) ** 2)
    square = (mean(cross.real) ** 2 + mean(cross.imag) ** 2) / np.maximum(norm, 1e-300)
    return np.asarray(square > _COHERENCE, dtype=bool)


def _edges(
    frequency: Array,
    values: Array,
    derivative: int = 0,
    common: npt.NDArray[np.bool_] | None = None,
) -> Array:
    """Return the (n,) band edges [Hz] of velocities or, by a derivative, of positions."""
    power = np.abs(_spectrum(values)) ** 2
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    # Single bins of noise scatter about their mean: only what stands out of it counts.
    signal = np.where(power > 10.0 * noise, power - noise, 0.0)
    if common is not None:
        signal *= common
    total = np.cumsum(signal * frequency[:, None] ** (2 * derivative), axis=0)
    edges = [np.searchsorted(column, _SHARE * column[-1]) for column in total.T]
    return np.asarray(frequency[edges])


# Gautier (ICRA 1997): a low-pass ten times above the motion leaves its dynamics alone.
_CUTOFF_PER_BAND = 10.0
_CUTOFF_MIN_PER_BAND = 0.5  # below, most of the motion is lost
# ... but there must be enough samples in a period of the cut-off to differentiate.
_SAMPLES_PER_CUTOFF = 10.0
_FEWEST_PER_CUTOFF = 5.0  # of which one could do with, where data say so
_LEAST_PER_POSITION_BAND = 4.0  # cut-offs below take part of the motion
# Cut-offs to try, as factors of the one by rule; below, down to the least, by the last one.
_TRIED = (0.5, 0.7, 1.0, 1.4, 2.0)
_LOWER = 0.5
# Trials are compared on samples in common: of no more than this rate, unless the motion is faster.
_TRIAL_RATE = 30.0  # [Hz]
_TRIAL_FINE_RATE = 200.0  # [Hz]
# The filtered torque is kept at five times the cut-off: above the Nyquist rate, 2, with room
# for the filter's slope.
_RATE_PER_CUTOFF = 5.0
# Before, signals are kept at this many times the cut-off: the steps of dry friction are then off
# by half a hundredth of the cut-off's period at most, and the filter removes what is faster.
_FINE_RATE_PER_CUTOFF = 100.0
_FINE_RATE_MIN = 400.0  # [Hz]; the motion doesn't slow down with the cut-off
_SEARCH_RATE = 250.0  # [Hz] is enough to find band and harmonics of any arm's motion
_EDGE = 0.5  # periods of the cut-off left out at the ends of a motion that isn't periodic
_FEWEST_PERIODS = 3.0  # of the cut-off in a motion that is only predicted
_EDGE_MOST = 0.1  # share of the motion
_SPREAD = 1.0  # periods of the cut-off to either side, over which it spreads saturated torque
_STANDSTILL_SPEED = 5e-3  # share of a joint's top speed
_STANDSTILL_TIME = 0.3  # [s]


class Conditioner:
    """Finds band and harmonics on the identification bags, and conditions any bag with them.

    Parameters
    ----------
    recordings : sequence of Recording
        The bags to identify from: nothing is learnt from a validation bag.
    options : ConditioningOptions
        What is already known.

    Attributes
    ----------
    cutoff : float
        Of the torque's low-pass [Hz]: the given one, else ten times the band, where the choice by
        data begins.
    cutoffs : tuple of float
        Those to choose from, rising [Hz]; only the given one if there is one.
    harmonics : int or None
        N of the excitation; None if a bag isn't periodic.
    fundamental : float or None
        f0 [Hz] of the first bag; None if a bag isn't periodic.
    band : float
        Frequency [Hz] below which the motion lies.
    delays : SignalDelays
        How late measured velocities are, unless stamps are exact, and efforts, by
        `with_effort_delay`. That of efforts is taken off, that of velocities where the filter of
        the kinematics is `in_time`.
    warnings : list of str
        What of the options doesn't fit the motion, and motions that are short.

    Raises
    ------
    IdentificationError
        If a recording is too short, or the cut-off, the harmonics or the filter don't fit it.
    """

    def __init__(self, recordings: Sequence[Recording], options: ConditioningOptions) -> None:
        self._options = options
        self.delays = SignalDelays.none(len(recordings[0].joint_names))
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
                min(count_harmonics(dq, motion.periods) for dq in (measured, _slope(motion)))
                for measured, motion in zip(velocities, motions, strict=True)
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
                motion_band(m.q[m.window], None if m.dq is None else m.dq[m.window], m.dt)
                for m in motions
            )
        self.band = band
        dt = max(map(sampling_time, recordings))
        positions = max(position_band(m.q[m.window], m.dt) for m in motions)
        self.cutoff = self._given_cutoff(positions, dt) or self._rule(band, dt)
        self.cutoffs: tuple[float, ...] = (self.cutoff,)
        if options.cutoff is None:
            least = _LEAST_PER_POSITION_BAND * positions
            self.cutoffs = _tried(self.cutoff, least, 1.0 / (_FEWEST_PER_CUTOFF * dt))
        self._trial_rate = max(_TRIAL_RATE, _RATE_PER_CUTOFF * self.cutoff)
        if not options.exact_stamps:
            self.delays = replace(self.delays, velocity=velocity_lag(motions, self.cutoff))

    def at(self, cutoff: float) -> 'Conditioner':
        """Return the same with another cut-off [Hz]."""
        other = copy(self)
        other.cutoff = cutoff
        return other

    def with_effort_delay(self, delay: Array) -> 'Conditioner':
        """Return the same for efforts that are late by (n,) [s]."""
        other = copy(self)
        other.delays, other._motions = replace(self.delays, effort=delay), {}
        return other

    def candidates(self) -> list[KinematicsFilter]:
        """Return the kinematics filters to choose from, the simplest first."""
        wanted = self._options.filter
        filters = [KinematicsFilter(self.cutoff)]
        if self.harmonics is not None and self.fundamental is not None and wanted != 'butterworth':
            known = KinematicsFilter(self.cutoff, self.harmonics)
            all_below = KinematicsFilter(self.cutoff, self._harmonics_below_cutoff())
            filters = [known] if wanted == 'harmonics' else [known, all_below, *filters]
        return [
            replace(f, from_position=source)
            for source in (False, True)
            for f in dict.fromkeys(filters)
        ]

    def adapted(self, kinematics: KinematicsFilter) -> KinematicsFilter:
        """Return a filter of another cut-off as it is at this one."""
        harmonics = kinematics.harmonics
        if harmonics not in (None, self.harmonics):
            harmonics = self._harmonics_below_cutoff()
        return replace(kinematics, cutoff=self.cutoff, harmonics=harmonics)

    def _harmonics_below_cutoff(self) -> int:
        assert self.harmonics is not None and self.fundamental is not None
        return max(self.harmonics, int(self.cutoff / self.fundamental))

    def condition(
        self, recording: Recording, kinematics: KinematicsFilter, predicted: bool = False
    ) -> Samples:
        """Filter one bag.

        Parameters
        ----------
        recording : Recording
        kinematics : KinematicsFilter
        predicted : bool
            Whether its torque is only to be predicted: then it need not excite anything, and may be
            as short as the filter allows.

        Raises
        ------
        IdentificationError
            If the motion in it is too short.
        """
        fine = max(_FINE_RATE_PER_CUTOFF * self.cutoff, _FINE_RATE_MIN)
        shortest = min(SHORTEST, _FEWEST_PERIODS / self.cutoff) if predicted else SHORTEST
        coarse = _RATE_PER_CUTOFF * self.cutoff
        return self._at_rates(recording, kinematics, (fine, coarse), shortest)

    def trial(self, recording: Recording, kinematics: KinematicsFilter) -> Samples:
        """Filter one bag, at instants that are the same whatever the filter and its cut-off.

        Raises
        ------
        IdentificationError
            If the motion in it is too short.
        """
        fine = max(_TRIAL_FINE_RATE, self._trial_rate)
        return self._at_rates(recording, kinematics, (fine, self._trial_rate), SHORTEST)

    def _at_rates(
        self,
        recording: Recording,
        kinematics: KinematicsFilter,
        rates: tuple[float, float],
        shortest: float,
    ) -> Samples:
        """Filter one bag, with fine and coarse samples at no less than two rates [Hz]."""
        factor = _factor(recording, rates[0])
        step = _factor(recording, rates[1] * factor)
        motion = self._motion(recording, step, factor, shortest)
        if kinematics.in_time:
            motion = motion.with_velocity_earlier(self.delays.velocity)
        return self._samples(motion, kinematics, step)

    def forget_motions(self) -> None:
        """Free what is kept of recordings between one filter and the next."""
        self._motions.clear()

    def _motion(
        self, recording: Recording, multiple: int, factor: int, shortest: float = SHORTEST
    ) -> UniformMotion:
        """Return the motion with a whole number of decimated samples a period; found once."""
        if recording not in self._parts:
            fundamental = self._options.fundamental
            self._parts[recording] = find_periodic_part(recording.time, recording.q, fundamental)
        part = self._parts[recording]
        known = self._motions.get((recording, factor))
        if known is None or (known.period or 0) % multiple:
            late = self.delays.effort
            known = (
                aperiodic_motion(recording, factor, shortest, late)
                if part is None
                else periodic_motion(recording, part, multiple, factor, late)
            )
            self._motions[recording, factor] = known
        return known

    def _rule(self, band: float, dt: float) -> float:
        return min(_CUTOFF_PER_BAND * band, 1.0 / (_SAMPLES_PER_CUTOFF * dt))

    def _given_cutoff(self, band: float, dt: float) -> float | None:
        """Return the user's cut-off, if there is one, checked against that of the positions."""
        given, limit = self._options.cutoff, 0.4 / dt
        if given is not None and given > limit:
            raise IdentificationError(
                f"cutoff {given:g} Hz is above {limit:.3g} Hz, the highest that the bag's rate "
                f'of {1.0 / dt:.3g} Hz allows: choose a lower cutoff'
            )
        if given is not None and given < _CUTOFF_MIN_PER_BAND * band:
            raise IdentificationError(
                f'cutoff {given:g} Hz would filter out the motion, which reaches {band:.3g} Hz: '
                'choose a higher cutoff'
            )
        return given

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
            block=_blocks(motion, len(time), step),
        )

    def _kept(self, motion: UniformMotion, count: int, dt: float) -> npt.NDArray[np.bool_]:
        kept = np.ones(count, dtype=bool)
        wanted = int(np.ceil(_EDGE / (self.cutoff * dt)))
        edge = 0 if motion.period else min(wanted, int(_EDGE_MOST * count))
        if edge:
            kept[:edge] = kept[-edge:] = False
        return kept


def _tried(rule: float, least: float, highest: float) -> tuple[float, ...]:
    """Return cut-offs to try [Hz], rising: about the rule, and far below if the motion ends there.

    The rule asks velocities, whose noise may reach much further than the motion.
    """
    tried = [factor * rule for factor in _TRIED]
    while _LOWER * tried[0] >= least:
        tried.insert(0, _LOWER * tried[0])
    return tuple(c for c in tried if least <= c <= highest or c == rule)


def _factor(recording: Recording, rate: float) -> int:
    """Return how many recorded samples go into one at no less than a rate [Hz]."""
    # Stamps jitter: a ratio just below a whole number is meant to be one.
    return max(1, int(1.0 / (sampling_time(recording) * rate) + 1e-3))


def _rough_velocity(motion: UniformMotion) -> Array:
    return _slope(motion) if motion.dq is None else motion.dq[motion.window]


def _slope(motion: UniformMotion) -> Array:
    """Return positions differentiated [rad/s]."""
    return np.asarray(np.gradient(motion.q, motion.dt, axis=0)[motion.window])


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


def _blocks(motion: UniformMotion, count: int, step: int) -> npt.NDArray[np.intp]:
    """Return consecutive parts of the motion; a periodic motion's repetitions go together."""
    length = motion.period // step if motion.period else count
    return np.asarray((np.arange(count) % length) * BLOCKS // length, dtype=np.intp)
