"""Conditioning of recordings: periods, filters and sampling rates, thesis section 3.5."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.motion_check import (
    ConditioningOptions,
    PeriodicPart,
    count_harmonics,
    find_periodic_part,
    fundamental_warnings,
    short_motion_warnings,
)
from aerarm_ros.identification.conditioning.spectral_filter import (
    MEMORY_PERIODS,
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
    at_rest,
    periodic_motion,
    sampling_time,
)
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class SignalDelays:
    """Delays of measured velocities and efforts relative to the positions in the same message.

    Attributes
    ----------
    velocity, effort : (n,) ndarray
        Delay of each joint's signal [s], positive if the signal lags behind the position.
    """

    velocity: Array
    effort: Array


# Smallest relevant lag: a twentieth of a period at 25 Hz. Smaller lags are not significant.
_LEAST = 2e-3  # [s]
_CLEAR = 3.0  # standard deviations
_CORRELATION = 0.5  # number of cut-off periods per independent sample


def velocity_lag(motions: Sequence[UniformMotion], cutoff: float) -> Array:
    """Return the delay of measured velocities relative to the derivative of the positions.

    Both signals pass the same low-pass filter. A velocity with delay e equals the derivative minus
    e times the acceleration, so least squares yield e without a model of the arm.

    Parameters
    ----------
    cutoff : float
        Cut-off frequency of the low-pass filter [Hz].

    Returns
    -------
    (n,) ndarray
        Delay [s]; 0 if velocities were not measured, or the delay is small or insignificant.
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


# Averaged bins of the spectrum, and the least squared coherence of a motion. Independent noise
# exceeds it with a probability of 1e-6: 1 - 1e-6^(1 / (bins - 1)).
_COHERENCE_BINS = 17
_COHERENCE = 0.58
_SHARE = 0.999  # fraction of a velocity signal's power that lies below the upper edge of its band


def motion_band(q: Array, dq: Array | None, dt: float) -> float:
    """Return the frequency [Hz] below which nearly all power of the joints' velocities lies.

    Parameters
    ----------
    q : (M, n) ndarray
        Joint positions [rad].
    dq : (M, n) ndarray or None
        Measured joint velocities [rad/s]. Position and velocity contain the same motion with
        different noise, so only frequencies at which both agree are counted; the narrower band of
        the two is used.
    dt : float
        Sampling time [s].

    Returns
    -------
    float
        Largest band edge of all joints [Hz]. White measurement noise, estimated from the upper
        half of the spectrum, is subtracted first. Frequencies that only bursts, such as jolts at
        a trajectory's corners, or the vibration of one joint contain are excluded.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    edges = _edges(frequency, q, derivative=1)
    if dq is not None:
        common = _coherent(q, dq)
        for own in (None, common):
            edges = np.minimum(edges, _edges(frequency, dq, common=own))
        edges = np.minimum(edges, _edges(frequency, q, derivative=1, common=common))
    edges = _without_bursts(frequency, q if dq is None else dq, int(dq is None), edges)
    return float(max(np.max(edges, initial=0.0), frequency[1]))


def position_band(q: Array, dt: float) -> float:
    """Return the frequency [Hz] below which nearly all power of the joint positions lies.

    The band of positions is narrower than that of velocities, which grow with frequency. Noise
    hardly affects it, because every joint moves far more than its encoder noise.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    return float(max(np.max(_edges(frequency, q), initial=0.0), frequency[1]))


def _spectrum(values: Array) -> npt.NDArray[np.complex128]:
    window = np.hanning(len(values))[:, None]
    return np.asarray(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0))


def _coherent(q: Array, dq: Array) -> npt.NDArray[np.bool_]:
    """Return a mask (K, n) of the frequencies at which position and velocity are coherent.

    The noise of a filtered velocity falls with frequency, like a motion. The positions do not
    contain this noise, so the coherence of positions and velocities is low where noise dominates.
    A delay of the velocity does not change the coherence.
    """
    # Local import, because it takes 0.1 s and periodic motions do not need it.
    from scipy.ndimage import uniform_filter1d

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
    """Return for each joint the frequency [Hz] below which nearly all signal power lies, (n,)."""
    power = np.abs(_spectrum(values)) ** 2
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    # Single noise bins scatter about their mean; only values well above it count.
    signal = np.where(power > 10.0 * noise, power - noise, 0.0)
    if common is not None:
        signal *= common
    total = np.cumsum(signal * frequency[:, None] ** (2 * derivative), axis=0)
    edges = [np.searchsorted(column, _SHARE * column[-1]) for column in total.T]
    return np.asarray(frequency[edges])


# fraction of the blocks in which a joint moves that may contain bursts
_BURSTS = 0.2
_MOVING = 0.01  # power of a block with motion, relative to that of the joint's fastest block
# Least factor by which bursts raise an edge; fewer blocks of any motion have a slightly lower edge.
_RAISED = 1.1
_HALVINGS = 8  # of the logarithmic interval that contains an edge


def _without_bursts(frequency: Array, values: Array, derivative: int, edges: Array) -> Array:
    """Return band edges (n,) [Hz] that disregard short bursts and vibration of a single joint.

    A few jolts, or the vibration of one joint, contain more than a thousandth of a joint's power.
    The function ignores the 20 % of a joint's blocks with the most high-frequency power. Above the
    edge, the joints that move contain on average a thousandth of their remaining power.
    """
    spectrum = _spectrum(values)
    low, high = float(frequency[1]), float(max(edges.max(initial=0.0), frequency[1]))
    # Noise is white in `values`. The median ignores vibration above all edges.
    fast_part = frequency > min(high, 0.5 * frequency[-1])
    white = np.median(np.abs(spectrum[fast_part]) ** 2, axis=0) / np.log(2.0)
    weight = frequency**derivative
    spectrum *= weight[:, None]
    size = 2 * (len(frequency) - 1)
    block = np.arange(size) * BLOCKS // max(size, 1)

    def powers(above: float) -> Array:
        fast = np.fft.irfft(spectrum * (frequency > above)[:, None], size, axis=0)
        return np.array([np.bincount(block, own, BLOCKS) for own in (fast**2).T])

    def noise(above: float) -> Array:
        return np.asarray(white * 2.0 / size * (weight[frequency > above] ** 2).sum())

    whole = powers(0.0)
    total = whole.sum(axis=1)
    moves = powers(high).sum(axis=1) < 0.5 * total  # The other joints are at rest.
    if not moves.any():
        return edges
    signal = np.maximum(total - noise(0.0), 1e-300)
    moving = (whole > _MOVING * whole.max(axis=1, keepdims=True)).sum(axis=1)
    kept = np.arange(BLOCKS) < BLOCKS - np.floor(_BURSTS * moving)[:, None]
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        lasting = np.where(kept, np.sort(powers(middle), axis=1), 0.0).sum(axis=1)
        lasting = np.maximum(lasting - noise(middle) * kept.mean(axis=1), 0.0)
        share = (lasting / signal)[moves].mean()
        low, high = (low, middle) if share <= 1.0 - _SHARE else (middle, high)
    return np.where(edges > _RAISED * high, high, edges)


# Gautier (ICRA 1997): a low-pass filter ten times above the motion preserves its dynamics.
_CUTOFF_PER_BAND = 10.0
_CUTOFF_MIN_PER_BAND = 0.5  # below this factor of the band, most of the motion is lost
# Samples per period of the cut-off that differentiation needs, ...
_SAMPLES_PER_CUTOFF = 10.0
_FEWEST_PER_CUTOFF = 5.0  # ... and the smallest number, used only if the data require it
# factor of the band below which a cut-off removes part of the motion
_LEAST_PER_POSITION_BAND = 4.0
# Candidate cut-offs relative to the cut-off by the rule; lower candidates halve the smallest one,
# down to the least cut-off. A higher cut-off always predicts more of the recorded torque, because
# the kinematics then follow vibration, but its parameters extrapolate worse (decision 103).
_TRIED = (0.5, 0.7, 1.0)
_LOWER = 0.5
# Filters are compared on common samples, at least at this rate, or five times the cut-off if that
# is higher.
_TRIAL_RATE = 30.0  # [Hz]
_TRIAL_FINE_RATE = 200.0  # [Hz]
# The filtered torque is sampled at five times the cut-off: above the Nyquist rate, 2, with a margin
# for the filter's slope.
_RATE_PER_CUTOFF = 5.0
# Before filtering, signals are sampled at this multiple of the cut-off. The steps of dry friction
# are then accurate to half a hundredth of the cut-off period; the filter removes faster content.
_FINE_RATE_PER_CUTOFF = 100.0
# [Hz] smallest sampling rate, because a lower cut-off does not make the motion slower
_FINE_RATE_MIN = 400.0
# Longer motions, for which these rates would need more samples, are sampled more coarsely, because
# the errors of more steps average out. The lowest rate is this multiple of the cut-off.
_FINE_SAMPLES = 400_000
_FINE_RATE_LEAST = 40.0
# [Hz] sampling rate that suffices to find band and harmonics of any arm motion
_SEARCH_RATE = 250.0
_EDGE = 0.5  # cut-off periods excluded at both ends of an aperiodic motion
# smallest length, in cut-off periods, of a motion whose torque is only predicted
_FEWEST_PERIODS = 3.0
_EDGE_MOST = 0.1  # largest excluded fraction of the motion
_SPREAD = 1.0  # cut-off periods excluded before and after saturated torque
_STANDSTILL_TIME = 0.3  # [s]


class Conditioner:
    """Filter of recordings; cut-off and harmonics are determined from the identification bags.

    Parameters
    ----------
    recordings : sequence of Recording
        Identification bags; validation bags do not influence the choice.
    options : ConditioningOptions
        Settings given by the user.

    Attributes
    ----------
    cutoff : float
        Cut-off of the torque's low-pass filter [Hz]: the given one, or the one with which the
        choice by data begins: ten times the band, but at least four times the positions' band.
    cutoffs : tuple of float
        Cut-offs to try, in ascending order [Hz]; only the given one if the user has given one.
    harmonics : int or None
        Number of harmonics N of the excitation; None if a bag is not periodic.
    fundamental : float or None
        Fundamental frequency f0 [Hz] of the first bag; None if a bag is not periodic.
    band : float
        Frequency [Hz] below which the motion lies.
    delays : SignalDelays
        Delays of measured velocities and of efforts (0 before
        `with_effort_delay`). The delay of efforts is always corrected, that of velocities only if
        the kinematics filter is `in_time`.
    warnings : list of str
        Warnings about options that contradict the motion, and about short motions.

    Raises
    ------
    IdentificationError
        If a recording is too short, or the cut-off, harmonics or filter do not fit the recording.
    """

    def __init__(self, recordings: Sequence[Recording], options: ConditioningOptions) -> None:
        self._options = options
        in_time = np.zeros(len(recordings[0].joint_names))
        self.delays = SignalDelays(in_time, in_time)
        self._parts: dict[Recording, PeriodicPart | None] = {}
        self._motions: dict[tuple[Recording, int], UniformMotion] = {}
        motions = [self._motion(r, 1, _factor(r, _SEARCH_RATE)) for r in recordings]
        velocities = [_slope(m) if m.dq is None else m.dq[m.window] for m in motions]
        self.harmonics: int | None = None
        self.fundamental: float | None = None
        self.warnings = [text for motion in motions for text in short_motion_warnings(motion)]
        if options.fundamental is not None:
            for motion in motions:
                self.warnings += fundamental_warnings(motion, options.fundamental)
        if all(motion.period for motion in motions):
            self.harmonics = max(
                min(count_harmonics(dq, motion.periods) for dq in (measured, _slope(motion)))
                for measured, motion in zip(velocities, motions, strict=True)
            )
            self.fundamental = 1.0 / ((motions[0].period or 1) * motions[0].dt)
            band = self.harmonics * self.fundamental
        else:
            band = max(
                motion_band(m.q[m.window], None if m.dq is None else m.dq[m.window], m.dt)
                for m in motions
            )
        self.band = band
        dt = max(map(sampling_time, recordings))
        positions = max(position_band(m.q[m.window], m.dt) for m in motions)
        least = _LEAST_PER_POSITION_BAND * positions
        lowest = max(band, least / _CUTOFF_PER_BAND)
        self.cutoff = self._given_cutoff(positions, dt) or min(
            _CUTOFF_PER_BAND * lowest, 1.0 / (_SAMPLES_PER_CUTOFF * dt)
        )
        self.cutoffs: tuple[float, ...] = (self.cutoff,)
        if options.cutoff is None:
            self.cutoffs = _tried(self.cutoff, least, 1.0 / (_FEWEST_PER_CUTOFF * dt))
        self._trial_rate = max(_TRIAL_RATE, _RATE_PER_CUTOFF * self.cutoff)
        self.delays = replace(self.delays, velocity=velocity_lag(motions, self.cutoff))

    def at(self, cutoff: float) -> 'Conditioner':
        """Return a copy of the conditioner with another cut-off [Hz]."""
        other = copy(self)
        other.cutoff = cutoff
        return other

    def with_effort_delay(self, delay: Array) -> 'Conditioner':
        """Return a copy of the conditioner that corrects the delays (n,) of the efforts [s]."""
        other = copy(self)
        other.delays, other._motions = replace(self.delays, effort=delay), {}
        return other

    def candidates(self) -> list[KinematicsFilter]:
        """Return the kinematics filters to try, the simplest first."""
        counts: list[int | None] = [None]
        if self.harmonics is not None:
            counts = [self.harmonics, self._harmonics_below_cutoff(), None]
        return [
            KinematicsFilter(self.cutoff, count, source)
            for source in (False, True)
            for count in dict.fromkeys(counts)
        ]

    def adapted(self, kinematics: KinematicsFilter) -> KinematicsFilter:
        """Return a copy of a kinematics filter with the cut-off of this conditioner."""
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
        """Filter the torque of a bag by the low-pass filter, and the motion by `kinematics`.

        The conditioner keeps no resampled motion afterwards, to save memory.

        Parameters
        ----------
        predicted : bool
            Whether the torque is only to be predicted. The motion then needs no excitation, and may
            be as short as the filter allows.

        Raises
        ------
        IdentificationError
            If the motion in the recording is too short.
        """
        fine = max(_FINE_RATE_PER_CUTOFF * self.cutoff, _FINE_RATE_MIN)
        enough = max(_FINE_SAMPLES / recording.duration, _FINE_RATE_LEAST * self.cutoff)
        shortest = min(SHORTEST, _FEWEST_PERIODS / self.cutoff) if predicted else SHORTEST
        coarse = _RATE_PER_CUTOFF * self.cutoff
        rates = min(fine, enough), coarse
        wanted = (recording, _factor(recording, rates[0]))
        for other in [known for known in self._motions if known != wanted]:
            del self._motions[other]
        samples = self._at_rates(recording, kinematics, rates, shortest)
        self._motions.clear()
        return samples

    def trial(self, recording: Recording, kinematics: KinematicsFilter) -> Samples:
        """Filter one bag for a comparison; sample times are equal for all filters and cut-offs.

        Raises
        ------
        IdentificationError
            If the motion in the recording is too short.
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
        """Filter one bag, with fine and coarse samples at the given minimum rates [Hz]."""
        factor = _factor(recording, rates[0])
        step = _factor(recording, rates[1] * factor)
        motion = self._motion(recording, step, factor, shortest)
        if kinematics.in_time:
            motion = motion.with_velocity_earlier(self.delays.velocity)
        return self._samples(motion, kinematics, step)

    def _motion(
        self, recording: Recording, multiple: int, factor: int, shortest: float = SHORTEST
    ) -> UniformMotion:
        """Return the resampled motion, with a whole number of decimated samples per period."""
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

    def _given_cutoff(self, band: float, dt: float) -> float | None:
        """Return the cut-off that the user has set, after checks; None if not set."""
        given, limit = self._options.cutoff, 0.4 / dt
        if given is not None and given > limit:
            raise IdentificationError(
                f"cutoff {given:g} Hz is above {limit:.3g} Hz, the highest that the bag's rate "
                f'of {1.0 / dt:.3g} Hz allows: choose a lower cutoff'
            )
        if given is not None and given < _CUTOFF_MIN_PER_BAND * band:
            raise IdentificationError(
                f'cutoff {given:g} Hz would filter out the motion, which contains frequencies up '
                f'to {band:.3g} Hz: choose a higher cutoff'
            )
        return given

    def _samples(self, motion: UniformMotion, kinematics: KinematicsFilter, step: int) -> Samples:
        q, dq, ddq = kinematics.apply(motion)
        gain = low_pass_gain(self.cutoff)
        settling = None if motion.period else SETTLING_PERIODS / self.cutoff
        memory = MEMORY_PERIODS / self.cutoff
        fine = SpectralFilter(motion.count, motion.dt, gain, step, settling, memory)
        time = motion.time[motion.window][::step]
        coarse = SpectralFilter(len(time), motion.dt * step, gain, 1, settling, memory)
        tau = motion.tau[motion.window]
        kept = np.ones(len(time), dtype=bool)
        if not motion.period:
            edge = int(np.ceil(_EDGE / (self.cutoff * motion.dt * step)))
            edge = min(edge, int(_EDGE_MOST * len(time)))
            kept[:edge] = kept[len(time) - edge :] = False
        still = _standing_still(dq[::step], motion.dt * step)
        recording = motion.recording
        measured = kept[:, None] & ~recording.dead_effort
        if recording.saturated is not None:
            measured &= ~_near(recording, recording.saturated, time, _SPREAD / self.cutoff)
        return Samples(
            name=recording.name,
            recorded=motion.count * motion.factor,
            time=time,
            q=q[::step].copy(),  # a view would keep the fine positions in memory
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
            cycle=(motion.period or 0) // step if kinematics.repeats(motion) else len(time),
        )


def _tried(rule: float, least: float, highest: float) -> tuple[float, ...]:
    """Return candidate cut-offs [Hz] in ascending order; the last one is the cut-off `rule`.

    The rule uses velocities, whose noise may extend far beyond the motion's band.
    """
    tried = [factor * rule for factor in _TRIED]
    while _LOWER * tried[0] >= least:
        tried.insert(0, _LOWER * tried[0])
    return tuple(c for c in tried if least <= c <= highest or c == rule)


def _factor(recording: Recording, rate: float) -> int:
    """Return the largest decimation factor that keeps the sampling rate at `rate` [Hz] or above."""
    # Stamps jitter, so a ratio just below a whole number counts as that number.
    return max(1, int(1.0 / (sampling_time(recording) * rate) + 1e-3))


def _slope(motion: UniformMotion) -> Array:
    """Return the velocities [rad/s] in the motion's window, differentiated from the positions."""
    return np.asarray(np.gradient(motion.q, motion.dt, axis=0)[motion.window])


def _standing_still(dq: Array, dt: float) -> npt.NDArray[np.bool_]:
    """Return a mask of samples in which a joint rests, so that its dry friction is unknown."""
    slow = at_rest(dq)
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
    """Return a mask (K, n) of the times (K,) within `distance` [s] of a flagged sample."""
    near = np.zeros((len(time), flags.shape[1]), dtype=bool)
    for joint in range(flags.shape[1]):
        flagged = recording.time[flags[:, joint]]
        first = np.searchsorted(flagged, time - distance)
        near[:, joint] = first < np.searchsorted(flagged, time + distance, side='right')
    return near


def _blocks(motion: UniformMotion, count: int, step: int) -> npt.NDArray[np.intp]:
    """Return the block number of each sample; the same part of each period has the same number."""
    length = motion.period // step if motion.period else count
    return np.asarray((np.arange(count) % length) * BLOCKS // length, dtype=np.intp)
