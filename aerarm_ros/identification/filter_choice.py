"""Choice of effort delay, gravity tilt, cut-off and filter by the error of held-out torque."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.spectral_filter import SETTLING_PERIODS, SpectralFilter
from aerarm_ros.identification.conditioning.uniform_motion import KinematicsFilter, Samples
from aerarm_ros.identification.joint_model import ArmParameters, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.simple_fit import (
    SIMPLE_TERMS,
    SimpleFit,
    block_sums,
    standard_errors,
)
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array

# Without this term, load-dependent friction would look like a delay.
_TERMS = (*SIMPLE_TERMS, JointTerm(TermKind.LOAD))
# [s] prior standard deviation; wide, because a narrow one biases the estimate towards 0
_SPREAD = 0.05
_ROUNDS = 10
_SETTLED = 5e-5  # [s] change of the delay at which the iteration ends
# [s] smallest delay that is corrected; smaller delays are within the accuracy of stamps and
# filters
_LEAST = 1e-3
# Longer estimated values are not delays of the signal. Friction that lags behind velocity, as in
# elastic gears, looks like a delay of 20 to 100 ms in joints whose torque is mostly friction.
_MOST = 0.015  # [s], decision 40
_LARGEST_ESTIMATE = 0.2  # [s] largest valid estimate
# standard errors by which a delay, and the improvement of held-out prediction, must exceed zero
_CLEAR = 2.0


@dataclass(frozen=True, eq=False)
class EffortDelay:
    """Delay of each joint's effort relative to its position.

    Attributes
    ----------
    found : (n,) ndarray
        Best-fitting delay [s], positive where the effort is late.
    used : (n,) ndarray
        Applied delay [s]; 0 where the estimate is not accepted.
    deviation : (n,) ndarray
        Standard deviation of the estimated delay [s].
    in_time : bool
        Whether the delay of velocities is also corrected.
    """

    found: Array
    used: Array
    deviation: Array
    in_time: bool = False


def find_effort_delay(
    bags: Sequence[SampleColumns],
    cad: ArmParameters,
    in_time: Sequence[SampleColumns] | None = None,
) -> EffortDelay:
    """Estimate the delay of each joint's effort; held-out parts of the motion test the estimate.

    For a small delay d, the measured torque equals the model torque minus d times the time
    derivative of the model torque, which is linear in d. The derivative of the predicted torque
    is used, because noise in the derivative of the measured torque would bias d towards zero. The
    estimated delay is removed from the measured torque and the estimation repeated until the rest
    is negligible.

    Parameters
    ----------
    bags : sequence of SampleColumns
        Identification bags.
    in_time : sequence of SampleColumns, optional
        Bags with corrected velocity delays, if velocities are late. Delays are then estimated
        with these bags, and the delays of all signals or of none are corrected.
    """
    n = bags[0].samples.n
    links = SimpleFit(bags, cad).theta[: 10 * n]
    plain = SimpleFit(bags, cad, (), _SPREAD, _TERMS, links)
    judged = list(bags if in_time is None else in_time)
    fit = plain if in_time is None else SimpleFit(judged, cad, (), _SPREAD, _TERMS, links)
    moved = judged
    found = np.zeros(n)
    for _ in range(_ROUNDS):
        # the derivative of filtered torque by the effort delay, one column per joint
        columns = [-rate[:, :, None] * np.eye(n) for rate in fit.rates()]
        fit = SimpleFit(moved, cad, columns, _SPREAD, _TERMS, links)
        step = fit.theta[10 * n : 11 * n]
        found = found + step
        if np.abs(step).max() < _SETTLED or np.abs(found).max() > _LARGEST_ESTIMATE:
            break
        moved = [_advanced(bag, found) for bag in judged]
    blocks = [bag.samples.block for bag in bags]
    gain = block_sums(blocks, plain.residuals()) - block_sums(blocks, fit.residuals())
    clear = np.array([standard_errors(of_joint) for of_joint in gain.T]) > _CLEAR
    deviation = fit.deviations()[10 * n : 11 * n]
    size = np.abs(found)
    accepted = clear & (size >= _LEAST) & (size <= _MOST) & (size > _CLEAR * deviation)
    if in_time is None:
        return EffortDelay(found, np.where(accepted, found, 0.0), deviation)
    together = bool(accepted.any()) and standard_errors(gain.sum(axis=1)) > _CLEAR
    return EffortDelay(found, np.where(accepted & together, found, 0.0), deviation, together)


def _advanced(bag: SampleColumns, delay: Array) -> SampleColumns:
    """Return a copy of a bag with the filtered torque shifted to earlier times by `delay` [s]."""
    samples: Samples = bag.samples
    dt = float(samples.time[1] - samples.time[0])
    settling = None if samples.fine_filter.periodic else SETTLING_PERIODS * 5.0 * dt
    moved = [
        SpectralFilter(len(tau), dt, _lead(float(d)), settling=settling)(tau)
        for tau, d in zip(samples.tau.T, delay, strict=True)
    ]
    return bag.altered(samples=replace(samples, tau=np.column_stack(moved)))


def _lead(seconds: float) -> Callable[[Array], npt.NDArray[np.complex128]]:
    """Return the filter gain that shifts a signal to earlier times by `seconds`."""
    return lambda frequency: np.asarray(np.exp(2j * np.pi * frequency * seconds))


_TILT_SPREAD = 0.02  # [rad] prior standard deviation of the base tilt
# repeated, because the torque caused by a tilt depends on the links' masses, and vice versa
_TILT_ROUNDS = 2
# A tilt is accepted if it lowers the held-out squared error by this fraction in most parts of the
# motion. In measurements a tilt lowered this error by at most 0.4 % for level robots, and by 12 %
# or more for tilted ones.
_LEAST_GAIN = 0.05


@dataclass(frozen=True, eq=False)
class GravityDirection:
    """Direction of gravity, as stated by the user and as estimated from the motion.

    Attributes
    ----------
    stated, used : (3,) ndarray
        Gravity in the base frame [m/s^2]; equal if the data show no tilt.
    error : float or None
        Held-out squared torque error with the best tilt, relative to the error without tilt; None
        if no tilt was estimated.
    """

    stated: Array
    used: Array
    error: float | None = None

    @classmethod
    def stated_by(cls, robot: Robot) -> 'GravityDirection':
        """Return the direction of gravity that the user states for a robot."""
        stated = np.array(robot.gravity_in_base)
        return cls(stated, stated)

    @property
    def tilt(self) -> float:
        """Angle between stated and used gravity [rad]."""
        across = np.linalg.norm(np.cross(self.stated, self.used))
        return float(np.arctan2(across, self.stated @ self.used))


def find_gravity(
    robot: Robot, bags: Sequence[SampleColumns], cad: ArmParameters
) -> GravityDirection:
    """Estimate the tilt of the base from the torque; held-out parts of the motion test it.

    A tilt by the angle v changes gravity to `g + v x g`, whose torque is linear in v for given
    links. Half a degree on an arm of 10 kg causes a torque of 0.4 Nm about its first axis. Without
    tilt this torque biases the links' parameters: joints then seem to have less inertia than their
    links.

    Parameters
    ----------
    robot : Robot
        Robot with the stated gravity.
    bags : sequence of SampleColumns
        Identification bags of this robot.
    """
    stated = np.array(robot.gravity_in_base)
    size = float(np.linalg.norm(stated))
    if size == 0.0:
        return GravityDirection(stated, stated)
    plain = SimpleFit(bags, cad)
    axes = np.linalg.svd(stated[None] / size)[2][1:]
    links = cad.inertial.ravel()
    for _ in range(_TILT_ROUNDS):
        shared = [_tilt_columns(robot, bag, axes, links) for bag in bags]
        tilted = SimpleFit(bags, cad, shared, _TILT_SPREAD)
        links, angles = np.split(tilted.theta[: 10 * robot.n + 2], [10 * robot.n])
    blocks = [bag.samples.block for bag in bags]
    before, after = (block_sums(blocks, fit.residuals()).sum(axis=1) for fit in (plain, tilted))
    error = float(after.sum() / before.sum()) if before.sum() > 0.0 else 1.0
    if error > 1.0 - _LEAST_GAIN or 2 * np.sum(after < before) <= len(before):
        return GravityDirection(stated, stated, error)
    used = stated + np.cross(angles @ axes, stated)
    return GravityDirection(stated, used * (size / np.linalg.norm(used)), error)


_BLOCK = 4096  # samples


def _tilt_columns(robot: Robot, bag: SampleColumns, axes: Array, links: Array) -> Array:
    """Return the derivative of filtered torque by the base tilt about each axis [Nm/rad]."""
    motion = bag.motion
    parts = np.empty((*motion.q.shape, len(axes)))
    for k, axis in enumerate(axes):
        turned = Regressor(robot.with_gravity(np.cross(axis, robot.gravity_in_base)))
        # In blocks, because the regressor of half an hour needs hundreds of megabytes.
        for first in range(0, len(motion.q), _BLOCK):
            q = motion.q[first : first + _BLOCK]
            rest = np.zeros_like(q)
            parts[first : first + _BLOCK, :, k] = turned.stack_rigid(q, rest, rest) @ links
    return bag.whole(motion.coarse_filter(parts))


_BY_CHANCE = 2.0  # standard errors by which the best of several filters may be better by chance
_SIMILAR = 1.2  # largest ratio of the squared errors of two equally good filters
_ENOUGH = 60.0  # [s] length of the excerpt that is used from the middle of a long recording


@dataclass(frozen=True, eq=False)
class FilterChoice:
    """Comparison of filters, with the samples of the best filter.

    Attributes
    ----------
    trials : dict of KinematicsFilter to float
        Error of recorded torque [%] on held-out parts of the motion, with each tried filter; the
        cut-off of the torque's low-pass filter equals that of the kinematics filter.
    conditioner : Conditioner
        Conditioner with the chosen cut-off.
    kinematics : KinematicsFilter
        Chosen filter.
    bags : list of SampleColumns
        Recordings filtered with the chosen filter.
    """

    trials: dict[KinematicsFilter, float]
    conditioner: Conditioner
    kinematics: KinematicsFilter
    bags: list[SampleColumns]

    def excerpts(
        self, regressor: Regressor, recordings: Sequence[Recording], in_time: bool = False
    ) -> list[SampleColumns]:
        """Return the filtered recordings; of a long recording only an excerpt.

        With `in_time`, the delay of measured velocities is corrected.
        """
        parts = [excerpt(recording) for recording in recordings]
        if not in_time and all(part is r for part, r in zip(parts, recordings, strict=True)):
            return self.bags
        kinematics = replace(self.kinematics, in_time=in_time or self.kinematics.in_time)
        return [condition_once(regressor, self.conditioner, part, kinematics) for part in parts]

    @property
    def has_late_velocities(self) -> bool:
        """Whether the filter uses measured velocities whose delay is not corrected."""
        kinematics = self.kinematics
        as_measured = not (kinematics.from_position or kinematics.in_time)
        return as_measured and bool(self.conditioner.delays.velocity.any())

    def with_effort_delay(
        self, regressor: Regressor, recordings: Sequence[Recording], delay: EffortDelay
    ) -> 'FilterChoice':
        """Return the filter choice with corrected delays of all signals."""
        if not delay.used.any() and not delay.in_time:
            return self
        moved = self.conditioner.with_effort_delay(delay.used)
        kinematics = replace(self.kinematics, in_time=self.kinematics.in_time or delay.in_time)
        bags = [condition_once(regressor, moved, r, kinematics) for r in recordings]
        return replace(self, conditioner=moved, kinematics=kinematics, bags=bags)


def choose_filter(
    regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
) -> FilterChoice:
    """Try all cut-offs and kinematics filters that the recordings allow.

    Real motion contains more than the commanded harmonics, such as the ripple of dry friction.
    Measured velocities may be late or noisy. The filter with the smallest error of recorded (not
    filtered) torque in held-out parts is chosen; filtered torque would favour the lowest cut-off.
    Of equally good cut-offs, the one nearest to ten times the motion's band is chosen.

    Parameters
    ----------
    recordings : sequence of Recording
        Identification bags.

    Raises
    ------
    IdentificationError
        If a recording is too short.
    """
    trials = _Trials(regressor, conditioner, recordings)
    rule = conditioner.cutoff
    family = trials.best_at(rule)
    # All lower cut-offs are tried, because the errors have local minima if noise misleads the rule.
    for cutoff in conditioner.cutoffs:
        if cutoff < rule:
            trials.run(cutoff, family)
    cutoff = trials.nearest(rule)
    kinematics = family if cutoff == rule else trials.best_at(cutoff)
    chosen = conditioner.at(cutoff)
    bags = [condition_once(regressor, chosen, r, kinematics) for r in recordings]
    return FilterChoice(trials.tried, chosen, kinematics, bags)


def condition_once(
    regressor: Regressor,
    conditioner: Conditioner,
    recording: Recording,
    kinematics: KinematicsFilter,
    predicted: bool = False,
) -> SampleColumns:
    """Return the regressor columns of a filtered bag."""
    return SampleColumns(conditioner.condition(recording, kinematics, predicted), regressor)


class _Trials:
    """Trials of filters (each filter once), and comparison of the torque errors."""

    def __init__(
        self, regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
    ) -> None:
        self._regressor = regressor
        self._conditioner = conditioner
        self._excerpts = [excerpt(recording) for recording in recordings]
        self._measured = all(recording.dq is not None for recording in recordings)
        self._cad = ArmParameters.stated(regressor.robot, None)
        self._residuals: dict[KinematicsFilter, list[Array]] = {}
        self._samples: list[Samples] = []  # of one trial; all have the same times and torques

    def run(self, cutoff: float, like: KinematicsFilter) -> None:
        """Try a cut-off [Hz] with a kinematics filter of the same type as `like`."""
        conditioner = self._conditioner.at(cutoff)
        kinematics = conditioner.adapted(like)
        if kinematics not in self._residuals:
            self._samples = [conditioner.trial(excerpt, kinematics) for excerpt in self._excerpts]
            bags = [SampleColumns(own, self._regressor) for own in self._samples]
            self._residuals[kinematics] = SimpleFit(bags, self._cad).raw_residuals()

    def best_at(self, cutoff: float) -> KinematicsFilter:
        """Try the kinematics filters at one cut-off, and return the best.

        First all filters are tried with measured velocities, if available. Then the best filter
        is tried with the other sources of velocity.
        """
        candidates = self._conditioner.at(cutoff).candidates()
        source = not self._measured
        best = self._best_of(cutoff, [k for k in candidates if k.from_position == source])
        best = self._best_of(cutoff, [best, replace(best, from_position=True)])
        in_time = replace(best, in_time=True, from_position=False)
        if self._measured and self._conditioner.delays.velocity.any():
            self.run(cutoff, in_time)
            errors = self._squared_errors()
            if standard_errors(errors[best] - errors[in_time]) > _BY_CHANCE:
                return in_time
        return best

    def _best_of(self, cutoff: float, candidates: Sequence[KinematicsFilter]) -> KinematicsFilter:
        for kinematics in candidates:
            self.run(cutoff, kinematics)
        errors = self._squared_errors()
        return min(candidates, key=lambda kinematics: float(errors[kinematics].sum()))

    def nearest(self, rule: float) -> float:
        """Return the cut-off nearest to `rule`, among those as good as the best cut-off.

        Two cut-offs count as equally good if chance explains their difference, given its
        variation over the blocks of the motion, and the difference is small. If few blocks cause
        a difference, its standard error is large, so a second limit applies.
        """
        errors = self._squared_errors()
        least = min(errors.values(), key=lambda own: float(own.sum()))
        good = [
            k.cutoff
            for k, own in errors.items()
            if standard_errors(own - least) <= _BY_CHANCE and own.sum() <= _SIMILAR * least.sum()
        ]
        return min(good, key=lambda cutoff: abs(np.log(cutoff / rule)))

    @property
    def tried(self) -> dict[KinematicsFilter, float]:
        """Torque error [%] with each tried filter."""
        torque = self._sums([samples.tau_raw for samples in self._samples]).sum()
        return {
            kinematics: 100.0 * float(np.sqrt(own.sum() / max(torque, 1e-12)))
            for kinematics, own in self._squared_errors().items()
        }

    def _squared_errors(self) -> dict[KinematicsFilter, Array]:
        """Return squared errors per trial and block, over the samples that all trials have."""
        return {kinematics: self._sums(own) for kinematics, own in self._residuals.items()}

    def _sums(self, torques: Sequence[Array]) -> Array:
        """Return the squares of torques per block, over the samples that all trials have."""
        known = zip(*self._residuals.values(), strict=True)
        common = [np.logical_and.reduce([np.isfinite(own) for own in of_bag]) for of_bag in known]
        sums = block_sums([own.block for own in self._samples], torques, common)
        return np.asarray(sums.sum(axis=1))


def excerpt(recording: Recording) -> Recording:
    """Return the middle minute of a long recording, which is enough to compare filters."""
    if recording.duration <= _ENOUGH:
        return recording
    share = 0.5 * _ENOUGH / recording.duration
    return recording.part(0.5 - share, 0.5 + share, '')
