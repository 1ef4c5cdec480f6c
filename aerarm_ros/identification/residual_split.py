"""Split of the torque residual by causes, to show what limits the accuracy.

Two causes are random: torque noise, and noise of position and velocity. To measure their size,
white noise is added to the recording, with the level found in the upper half of the recorded
spectra. The recordings with and without added noise pass the same filters. Each other cause has a
torque with a known pattern. The residual is fitted by these patterns, minus the part that the
model's parameters absorb. Causes are added in the order of the residual that they explain. The
explained fraction is computed in held-out parts of the recording, so that chance explains almost
nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.spectral_filter import SETTLING_PERIODS, SpectralFilter
from aerarm_ros.identification.conditioning.uniform_motion import FOLDS, KinematicsFilter, Samples
from aerarm_ros.identification.model_choice.model_choice import DISTANCES
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array

TORQUE_NOISE, MOTION_NOISE = 'torque noise', 'position and velocity noise'
RIPPLE, FLEXIBILITY = 'gear ripple', 'joint flexibility'
DELAY, REVERSAL = 'torque delay', 'friction at reversal'

REMEDIES: Mapping[str, str] = {
    TORQUE_NOISE: 'record more periods or longer, or choose a lower cut-off',
    MOTION_NOISE: 'choose a lower cut-off, accelerate less, or use finer encoders',
    RIPPLE: (
        'compensate the periodic torque of the gears, or move faster, so that the low-pass '
        'filter removes this torque'
    ),
    FLEXIBILITY: 'accelerate less, or measure the angles on the output side of the gears',
    DELAY: (
        'record torque and angle at the same instant, or omit --exact-stamps, so that the '
        'identifier estimates the delay'
    ),
    REVERSAL: 'reverse less often, or pass through zero velocity faster',
}
"""Advice that reduces each cause of the torque residual."""

UNEXPLAINED = 'calibrate the geometry, check tool and cables, or record a more varied motion'
"""Advice that reduces a torque residual without known cause."""

_RANDOM = (TORQUE_NOISE, MOTION_NOISE)
_LARGEST_RATIO, _RATIO_STEP = 200.0, 0.25  # largest value and step of the searched gear ratios
_SEARCHED = 4000  # number of samples, enough to find a period
# smallest explained fraction of the mean square; smaller gains are due to chance
_LEAST_GAIN = 0.01
_RIDGE = 1e-4  # regularization, which prevents large opposite coefficients of similar patterns


@dataclass(frozen=True, eq=False)
class ResidualSplit:
    """Fractions of a bag's filtered torque residual, by cause.

    Attributes
    ----------
    bag : str
        Name of the bag.
    rms : (n,) ndarray
        RMS of each joint's residual [Nm].
    fractions : dict of str to (n,) ndarray
        Fraction of the residual's mean square that each cause explains, by cause (a key of
        `REMEDIES`); the rest is unexplained.
    above_cutoff : (n,) ndarray
        Fraction of the unfiltered residual's mean square that the torque's low-pass filter removes.
    """

    bag: str
    rms: Array
    fractions: dict[str, Array]
    above_cutoff: Array

    @property
    def unexplained(self) -> Array:
        """Fraction (n,) of the residual's mean square without known cause."""
        return np.asarray(1.0 - sum(self.fractions.values()))


def split_residual(
    regressor: Regressor,
    conditioner: Conditioner,
    kinematics: KinematicsFilter,
    estimate: Estimate,
    recording: Recording,
    ratios: Array | None = None,
) -> ResidualSplit:
    """Split the torque residual of an estimate, in one recording, by its causes.

    Parameters
    ----------
    conditioner : Conditioner
        Conditioner with the cut-off and delays of the identification.
    recording : Recording
        Recording of at least some seconds; one minute is sufficient.
    ratios : (n,) ndarray, optional
        Motor turns per joint turn; if omitted, the periods of ripple are searched.

    Raises
    ------
    IdentificationError
        If the motion is too short for the filter.
    """

    def conditioned(recording: Recording) -> SampleColumns:
        return SampleColumns(conditioner.condition(recording, kinematics, True), regressor)

    bag = conditioned(recording)
    samples = bag.samples
    prediction = bag.predict(estimate.model, estimate.theta)
    residual, raw = samples.tau - prediction.filtered, samples.tau_raw - prediction.raw
    noise = _noise_torques(bag, conditioned(_with_noise(recording)), estimate)
    patterns = _patterns(regressor, estimate, bag, prediction.filtered, residual, ratios)
    n = samples.n
    rms, above = np.full(n, np.nan), np.full(n, np.nan)
    fractions = {cause: np.full(n, np.nan) for cause in REMEDIES}
    for joint in np.flatnonzero(samples.measured.any(axis=0)).tolist():
        rows = samples.measured[:, joint]
        power = max(float(np.mean(residual[rows, joint] ** 2)), 1e-300)
        rms[joint] = math.sqrt(power)
        above[joint] = max(1.0 - power / max(float(np.mean(raw[rows, joint] ** 2)), 1e-300), 0.0)
        parts = {c: float(np.mean(noise[c][rows, joint] ** 2)) / power for c in _RANDOM}
        parts |= _explained(
            residual[rows, joint],
            {cause: columns[joint][rows] for cause, columns in patterns.items()},
            samples.fold[rows],
        )
        whole = max(sum(parts.values()), 1.0)
        for cause, part in parts.items():
            fractions[cause][joint] = part / whole
    return ResidualSplit(recording.name, rms, fractions, above)


def white_noise(values: Array) -> Array:
    """Return the standard deviation of white noise in signals (M, n).

    The result is the smaller of two estimates. The median over the upper half of the spectrum is
    not affected by motion and narrow peaks, but by steps. The median of second differences is not
    affected by steps, such as those of dry friction, but by fast motion.
    """
    window = np.hanning(len(values))[:, None]
    slope = np.linspace(0.0, 1.0, len(values))[:, None] * (values[-1] - values[0])
    power = np.abs(np.fft.rfft((values - slope) * window, axis=0)) ** 2
    level = np.median(power[len(power) // 2 :], axis=0) / math.log(2.0)
    by_spectrum = np.sqrt(level / (window**2).sum())
    second = np.abs(np.diff(values, 2, axis=0))
    by_difference = np.median(second, axis=0) / (NormalDist().inv_cdf(0.75) * math.sqrt(6.0))
    # With a coarse encoder most differences are zero.
    by_difference[by_difference == 0.0] = np.inf
    return np.asarray(np.minimum(by_spectrum, by_difference))


def _with_noise(recording: Recording) -> Recording:
    """Return a recording with additional white noise of the measured level."""
    random = np.random.default_rng(0)

    def noisy(values: Array) -> Array:
        return values + white_noise(values) * random.standard_normal(values.shape)

    q, measured = noisy(recording.q), recording.dq
    dq = None if measured is None else noisy(measured)
    return replace(recording, q=q, dq=dq, tau=noisy(recording.tau))


def _noise_torques(
    bag: SampleColumns, noisy: SampleColumns, estimate: Estimate
) -> dict[str, Array]:
    """Return the filtered torque (M, n) [Nm] that noise of the measured level causes."""

    def change(before: Array, after: Array) -> Array:
        # Noise may shift the ends of the motion by some samples.
        time = noisy.samples.time
        spline = CubicSpline(time, after)
        return np.asarray(spline(np.clip(bag.samples.time, time[0], time[-1])) - before)

    predicted = [each.predict(estimate.model, estimate.theta).filtered for each in (bag, noisy)]
    return {
        TORQUE_NOISE: change(bag.samples.tau, noisy.samples.tau),
        MOTION_NOISE: change(*predicted),
    }


def _patterns(
    regressor: Regressor,
    estimate: Estimate,
    bag: SampleColumns,
    predicted: Array,
    residual: Array,
    ratios: Array | None,
) -> dict[str, list[Array]]:
    """Return the filtered torque patterns (M, k) of each cause, by cause and joint."""
    samples = bag.samples
    inertial = estimate.theta[: 10 * samples.n]
    fine = _fine_positions(samples)
    derive = _derivative(samples)
    bends = _bent(regressor, inertial, bag, derive)
    # For a delay of about the filter's period or more, the second derivative is also needed.
    rates = np.stack([derive(predicted, 1), derive(predicted, 2)], axis=2)
    absorbed = _Absorption(bag, estimate)
    patterns = {
        RIPPLE: [_ripple(samples, fine, residual, j, ratios) for j in range(samples.n)],
        FLEXIBILITY: list(bends),
        DELAY: [rates[:, j] for j in range(samples.n)],
        REVERSAL: [_presliding(samples, fine[:, j], j) for j in range(samples.n)],
    }
    return {
        cause: [absorbed.rest(columns, joint) for joint, columns in enumerate(own)]
        for cause, own in patterns.items()
    }


class _Absorption:
    """Least-squares fit of the model's parameters, which absorbs a part of every pattern."""

    def __init__(self, bag: SampleColumns, estimate: Estimate) -> None:
        samples, model = bag.samples, estimate.model
        inertial = estimate.theta[: 10 * samples.n]
        columns = model.joint_columns
        self._usable = samples.usable
        self._rows = []
        for joint in range(samples.n):
            rows = np.zeros((len(samples.time), 10 * samples.n + len(columns)))
            rows[:, : 10 * samples.n] = bag.rigid[:, joint]
            for index, (own, term) in enumerate(columns):
                if own == joint:
                    rows[:, 10 * samples.n + index] = bag.term(term, inertial)[:, joint]
            self._rows.append(rows)
        used = [r[u] for r, u in zip(self._rows, self._usable.T, strict=True)]
        self._inverse = np.linalg.pinv(sum(r.T @ r for r in used), rcond=1e-12, hermitian=True)

    def rest(self, pattern: Array, joint: int) -> Array:
        """Return the part of a joint's torque (M, k) that the parameters do not absorb [Nm]."""
        rows, usable = self._rows[joint], self._usable[:, joint]
        return np.asarray(pattern - rows @ (self._inverse @ (rows[usable].T @ pattern[usable])))


def _fine_positions(samples: Samples) -> Array:
    """Return joint positions (L, n) at the rate of the fine velocities [rad]."""
    coarse = np.arange(len(samples.q)) * samples.step
    return np.asarray(CubicSpline(coarse, samples.q)(np.arange(len(samples.dq_fine))))


def _derivative(samples: Samples) -> Callable[[Array, int], Array]:
    filtered = samples.coarse_filter
    settling = None if filtered.periodic else SETTLING_PERIODS * 5.0 * filtered.dt
    return SpectralFilter(filtered.count, filtered.dt, np.ones_like, settling=settling)


def _ripple(
    samples: Samples, fine: Array, residual: Array, joint: int, ratios: Array | None
) -> Array:
    """Return filtered sinusoids of joint and motor angle; an unknown gear ratio is estimated."""
    rows = np.flatnonzero(samples.measured[:, joint])
    angle, left = samples.q[rows, joint], residual[rows, joint]
    orders = [1.0, 2.0]
    if ratios is not None:
        orders += [abs(float(ratios[joint])), 2.0 * abs(float(ratios[joint]))]
    stride = max(1, len(rows) // _SEARCHED)
    tried = np.arange(3.0, _LARGEST_RATIO, _RATIO_STEP)
    wave = np.exp(1j * tried[0] * angle[::stride])
    turn = np.exp(1j * _RATIO_STEP * angle[::stride])
    sizes = []
    for _ in tried:  # products are much faster than exponentials
        sizes.append(abs(wave @ left[::stride]))
        wave = wave * turn
    orders.append(float(tried[np.argmax(sizes)]))
    phase = np.outer(fine[:, joint], orders)
    return samples.fine_filter(np.hstack([np.sin(phase), np.cos(phase)]))


def _bent(
    regressor: Regressor, inertial: Array, bag: SampleColumns, derive: Callable[[Array, int], Array]
) -> Array:
    """Return the torque (n, M, n + 1) per compliance of each gear and of the joint's own rotor.

    A gear of compliance c places the link at q - c tau if the encoder is on the motor (one column
    per gear, by a finite difference of the rigid model). If the encoder is on the link, the rotor
    is at q + c tau.
    """
    samples = bag.samples
    tau = bag.links_torque(inertial)
    first, second = derive(tau, 1), derive(tau, 2)
    small = 1e-4 * np.ptp(samples.q, axis=0).max() / max(float(np.abs(tau).max()), 1e-300)
    columns = []
    for joint in range(samples.n):
        moved = [np.array(x) for x in (samples.q, samples.dq, samples.ddq)]
        for values, change in zip(moved, (tau, first, second), strict=True):
            values[:, joint] -= small * change[:, joint]
        bent = regressor.stack_rigid(*moved) @ inertial
        columns.append(samples.coarse_filter((bent - tau) / small))
    rotor = samples.coarse_filter(second)
    together = np.stack(columns, axis=2)  # axes: M samples, joint of the torque, compliant joint
    return np.concatenate([together, rotor[:, :, None]], axis=2).transpose(1, 0, 2)


def _presliding(samples: Samples, angle: Array, joint: int) -> Array:
    """Return the missing friction torque after reversals, one column per build-up distance."""
    direction = np.where(samples.dq_fine[:, joint] < 0.0, -1.0, 1.0)
    turned = np.flatnonzero(np.diff(direction)) + 1
    last = np.zeros(len(angle), dtype=np.intp)
    last[turned] = turned
    angle_since = np.abs(angle - angle[np.maximum.accumulate(last)])
    missing = [direction * np.exp(-angle_since / distance) for distance in DISTANCES]
    columns = np.column_stack(missing)
    # a reversal before the recording is unknown
    columns[: turned[0] if len(turned) else None] = 0.0
    return samples.fine_filter(columns)


def _explained(
    residual: Array, patterns: Mapping[str, Array], fold: npt.NDArray[np.intp]
) -> dict[str, float]:
    """Return the fraction that each cause explains, by forward selection, the largest first."""
    gains = dict.fromkeys(patterns, 0.0)
    chosen: list[str] = []
    known = 0.0
    while len(chosen) < len(patterns):
        left = [name for name in patterns if name not in chosen]
        tried = {
            name: _held_out_gain(residual, [patterns[n] for n in (*chosen, name)], fold)
            for name in left
        }
        best = max(left, key=tried.__getitem__)
        if tried[best] - known < _LEAST_GAIN:
            break
        gains[best], known = tried[best] - known, tried[best]
        chosen.append(best)
    return gains


def _held_out_gain(residual: Array, groups: list[Array], fold: npt.NDArray[np.intp]) -> float:
    """Return the fraction of the mean square residual that patterns explain in held-out data."""
    columns = np.hstack(groups)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    products = [columns[fold == k].T @ columns[fold == k] for k in range(FOLDS)]
    targets = [columns[fold == k].T @ residual[fold == k] for k in range(FOLDS)]
    ridge = _RIDGE * np.eye(columns.shape[1])
    left = 0.0
    for k in range(FOLDS):
        seen = [i for i in range(FOLDS) if i != k]
        matrix = ridge + sum(products[i] for i in seen)
        found = np.linalg.solve(matrix, sum(targets[i] for i in seen))
        left += float(np.sum((residual[fold == k] - columns[fold == k] @ found) ** 2))
    return 1.0 - left / max(float(residual @ residual), 1e-300)
