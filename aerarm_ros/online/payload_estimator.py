"""What the last link carries, found while the arm moves."""

from collections import deque
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import positive
from aerarm_ros.identification.payload import Payload
from aerarm_ros.model.inertia import PARAMETER_NAMES
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.filtered_motion import SLOW, FilteredMotion, MotionRow
from aerarm_ros.online.information_filter import (
    SPECK,
    Belief,
    InformationFilter,
    ball,
    nearest_body,
)

FRICTION_NAMES = ('viscous [Nms/rad]', 'Coulomb [Nm]', 'load')
"""Of the rows of `OnlineEstimate.friction`."""

_UNKNOWN = 0.5  # of the prior's standard deviation


@dataclass(frozen=True, eq=False)
class OnlineEstimate:
    """One estimate of a `PayloadEstimator`.

    Attributes
    ----------
    time : float
        Of the state that it follows [s].
    payload : Payload
        Beyond what the arm's model has; a speck of 1e-6 kg stands for nothing. Its covariance is
        that before it is known that the payload is a body.
    carries : bool
        Whether something is carried.
    since : float
        Time [s] of the last pick-up or put-down that was found; minus infinity before the first.
    prior_std : (10,) ndarray
        Of the payload's parameters, before there was a motion.
    friction, friction_std : (3, n) ndarray
        Viscous [Nms/rad], Coulomb [Nm] and load friction [-] of the joints, as they are by now.
    residual : (n,) ndarray
        RMS torque that remains unexplained [Nm].
    """

    time: float
    payload: Payload
    carries: bool
    since: float
    prior_std: Array
    friction: Array
    friction_std: Array
    residual: Array

    @property
    def unexcited(self) -> tuple[str, ...]:
        """Names of the parameters that the motion hardly excites: they are near the prior."""
        known = self.payload.std < _UNKNOWN * self.prior_std
        return tuple(
            name for name, is_known in zip(PARAMETER_NAMES, known, strict=True) if not is_known
        )


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of a `PayloadEstimator`; all are positive.

    Attributes
    ----------
    bandwidth : float
        Of the low-passes on both sides of the equation of motion [1/s]. What is faster is noise;
        what is picked up shows after some of its time constants.
    correlation_time : float
        For how long an error of the model stays what it is [s]. Errors within it count as one.
    payload_mass, payload_size : float
        Standard deviation of what may be picked up: its mass [kg], and the distance of its parts
        from the last joint [m].
    tare_mass : float
        Standard deviation of the mass [kg] by which the arm's model may be wrong at its last link.
    friction_spread : float
        Standard deviation of friction from what the model says, relative.
    torque_noise : float
        RMS torque [Nm] that the model leaves unexplained at first; it is measured from then on.
    model_error : float
        Standard deviation of gravity and inertia from what the model says, relative. What it may
        explain is no change of the payload.
    memory, friction_memory : float
        Time constants of forgetting [s], of payload and tare, and of friction.
    """

    bandwidth: float = 30.0
    correlation_time: float = 0.1
    payload_mass: float = 0.5
    payload_size: float = 0.15
    tare_mass: float = 0.01
    friction_spread: float = 0.3
    torque_noise: float = 0.02
    model_error: float = 0.01
    memory: float = 30.0
    friction_memory: float = 120.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for field in fields(self):
            positive(field.name, getattr(self, field.name))

    def body_scale(self, mass: float) -> np.ndarray:
        """Return standard deviations (10,) of a body of a mass [kg] and `payload_size`."""
        size = self.payload_size
        return mass * np.array([1.0, *[size] * 3, *[size**2] * 6])


class ChangeTest:
    """A cumulative sum of how much larger errors are than they should be.

    Page: Continuous inspection schemes (1954). An error counts by its square over its variance,
    less `allowed`, and up to a limit: one sample that is mad finds nothing.

    Parameters
    ----------
    allowed : float
        Mean of squared errors over their variance that is still in order.
    threshold : float
        Sum that tells a change.
    """

    def __init__(self, allowed: float = 5.0, threshold: float = 60.0) -> None:
        self._allowed = allowed
        self._threshold = threshold
        self._sum = 0.0

    def reset(self) -> None:
        """Begin anew."""
        self._sum = 0.0

    def update(self, square: float) -> bool:
        """Take a squared error over its variance, and tell whether there was a change."""
        change = min(square, 0.5 * self._threshold) - self._allowed
        self._sum = max(0.0, self._sum + change)
        return self._sum > self._threshold


_FROZEN = 0.2  # [s] in which a measured torque of a moving joint changes
_MOVING = 0.05  # [rad/s]


class EffortWatch:
    """Looks for joints that move while their torque stays the same to the last bit.

    Parameters
    ----------
    names : tuple of str
        Of the joints.

    Attributes
    ----------
    problem : str
        What is wrong, '' if nothing.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._before = np.full(len(names), np.nan)
        self._same = np.zeros(len(names))
        self.problem = ''

    def update(self, state: ArmState, dt: float) -> None:
        """Take a state, `dt` [s] after the one before."""
        is_same = state.tau == self._before
        self._before = np.array(state.tau)
        if not is_same.any() and not self.problem:
            self._same[:] = 0.0
            return
        self._same = np.where(is_same, self._same + dt * (np.abs(state.dq) > _MOVING), 0.0)
        frozen = np.flatnonzero(self._same > _FROZEN)
        self.problem = ''
        if len(frozen):
            names = ', '.join(self._names[index] for index in frozen)
            self.problem = (
                f'effort of {names} stays at {state.tau[frozen[0]]:.3g} Nm while the joint '
                'moves: check that joint_states has measured torques'
            )


PERIOD = 0.02
"""[s] between estimates, at least."""
# A longer silence [s] may hide anything.
_LONGEST_GAP = 0.05
_TARE, _LOAD = slice(0, 10), slice(10, 20)
_UNDONE = 0.3  # [s] before a change was found, it may have happened
_SETTLING = 0.15  # [s] after a change was found, in which the filter still holds what was before
_DECISION = 0.35  # [s] in which it shows whether a change was a put-down
_FAST = 2.0  # [s] after a change, in which nothing is forgotten and noise isn't measured
_TARE_TIME = 1.0  # [s] of motion without a sign of a payload, by which there is none
_SIGNIFICANT = 3.0  # standard deviations by which a payload must be more than nothing
_NOISE_TIME = 3.0  # [s] over which the unexplained torque is measured
_LARGEST = 5.0  # standard deviations from which on an error counts less
_SMALL_SHARE = 0.02  # standard deviation of load friction, where the model has none
_SMALL_FRICTION = 0.01  # [Nm], [Nms/rad]: the same of the others
_LEAST_NOISE = 0.25  # of the noise that was assumed


class _Phase(NamedTuple):
    """What the estimator takes the arm to do, and since when [s]."""

    carries: bool
    since: float


class PayloadEstimator:
    """Payload and friction from states at 1 kHz, in a fiftieth of a second each.

    A linear Bayesian filter in three blocks: the *tare*, a body by which the arm's model is wrong
    at its last link, learnt while nothing is carried; the *payload*, in the same columns while
    something is; and friction's deviation from the model, slowly. Payload and tare are told apart
    by time alone, so that an error of the arm's model that is the same before and after the
    pick-up is not weighed.

    What is picked up or put down shows in the innovations: their squares over their variance are
    summed up (`ChangeTest`). Then the belief of a moment before is taken back, and the payload
    begins anew from its wide prior (the fast phase), or ends. What is told is the body nearest to
    the payload's block (`nearest_body`), so its 4x4 pseudo-inertia is positive definite in every
    step.

    Parameters
    ----------
    dynamics : MovingBaseDynamics
        Of the arm, carrying nothing.
    viscous, coulomb, load_share : (n,) array_like
        Friction as it is known, see `FilteredMotion`.
    settings : EstimatorSettings, optional

    Attributes
    ----------
    estimate : OnlineEstimate or None
        The last good one; none before the first.
    changes : int
        Pick-ups and put-downs that were found.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        load_share: npt.ArrayLike,
        settings: EstimatorSettings | None = None,
    ) -> None:
        self.settings = s = settings or EstimatorSettings()
        self.link = dynamics.robot.link_names[-1]
        self._still = dynamics.still
        self._motion = FilteredMotion(dynamics, viscous, coulomb, load_share, s.bandwidth)
        known = self._motion
        least = np.repeat([_SMALL_FRICTION, _SMALL_FRICTION, _SMALL_SHARE], known.n)
        self._friction = np.concatenate([known.viscous, known.coulomb, known.load_share])
        self._friction_scale = s.friction_spread * self._friction + least
        self._tare_scale = s.body_scale(s.tare_mass)
        self._load_scale = s.body_scale(s.payload_mass)
        self._filter = InformationFilter(20 + len(self._friction))
        self._efforts = EffortWatch(dynamics.robot.joint_names)
        self._change = ChangeTest()
        # An error that stays for a while is one error, not one a period.
        self._repeated = 2.0 * s.correlation_time
        self.estimate: OnlineEstimate | None = None
        self.changes = 0
        self._last: float | None = None
        self._noise = np.full(known.n, s.torque_noise**2)
        self._period, self._elapsed = PERIOD, 0.0
        self._start_anew()

    @property
    def problem(self) -> str:
        """Reason why the arm cannot be estimated, '' if it can."""
        return self._efforts.problem or self._fault

    @property
    def is_tared(self) -> bool:
        """Whether the arm has moved for a second and shown no payload, so that one is news."""
        return self._bare_time >= _TARE_TIME

    def update(
        self, state: ArmState, now: float, base: BaseMotion | None = None
    ) -> OnlineEstimate | None:
        """Take the state of `now` [s], and return an estimate if a new one is due.

        A state with a number missing counts as lost. After a gap, or while something is wrong
        (`problem`), the last good estimate stays.

        Parameters
        ----------
        state : ArmState
        now : float
            [s]
        base : BaseMotion, optional
            Default: at rest, under the arm's own gravity.
        """
        if not np.isfinite(state.q.sum() + state.dq.sum() + state.tau.sum()):
            return None
        last, self._last = self._last, now
        if last is None or not 0.0 < now - last < _LONGEST_GAP:
            if last is None or now != last:
                self._interrupt()
                self._last = now
            return None
        self._efforts.update(state, now - last)
        if self._efforts.problem:
            self._motion.reset()
            return None
        self._elapsed += now - last
        if not self._motion.update(state, now - last, self._still if base is None else base):
            return None
        if self._elapsed < PERIOD - 1e-4 or not self._motion.is_settled:
            return None
        # States that come more seldom than 200 times a second make longer periods.
        self._period, self._elapsed = min(self._elapsed, _LONGEST_GAP + PERIOD), 0.0
        return self._learn(self._motion.row(), now)

    def pause(self) -> None:
        """Stop learning while the base's motion is unknown, or something holds the arm.

        That shows late: what was learnt in the 0.3 s before is taken back. The rest stays.
        """
        if self._history:
            self._filter.belief = self._history[0]
            self._history.clear()
            self._change.reset()
            if self.estimate is not None:
                self._tell(self.estimate.time)
        self._interrupt()

    def _interrupt(self) -> None:
        """Take note that states are missing."""
        self._motion.reset()
        self._elapsed = 0.0
        self._last = None

    def _start_anew(self) -> None:
        self._filter = InformationFilter(20 + len(self._friction))
        self._phase = _Phase(False, -np.inf)
        self._found: float | None = None
        self._fault = ''
        self._bare_time = 0.0
        self._quiet = 0.0
        self._elapsed = 0.0
        self._history: deque[Belief] = deque(maxlen=round(_UNDONE / PERIOD))
        self._change.reset()

    # One period.

    def _learn(self, row: MotionRow, now: float) -> OnlineEstimate | None:
        rows = self._rows(row)
        if self._fault:
            self._look_again(rows, row)
            return None
        if self._found is not None:
            self._decide(rows, row, now)
            return self._tell(now)
        if self._rests(row):
            # A push at rest looks like a payload; a payload shows as soon as the arm moves.
            self._change.reset()
            return self._tell(now)
        error, square = self._innovation(rows, row)
        if self._change.update(square):
            self._change_found(now)
            return None if self._fault else self._tell(now)
        if now - self._phase.since > _FAST:
            self._measure_noise(error, rows, row)
        if now - self._phase.since > _SETTLING:
            self._take(rows, row, error, now)
        told = self._tell(now)
        if told.carries and now - told.since > _FAST and _is_nothing(told.payload):
            # Something else was felt: a knock, or an error of the model.
            self._begin(False, now)
            told = self._tell(now)
        return told

    def _rests(self, row: MotionRow) -> bool:
        """Whether no joint moves, so that friction and a push explain any torque."""
        n = self._motion.n
        return bool(np.abs(row.regressor[:, 10 : 10 + n]).max() < SLOW)

    def _rows(self, row: MotionRow) -> Array:
        """Return what the n torques are, by the filter's parameters."""
        body, friction = row.regressor[:, :10], row.regressor[:, 10:]
        load = self._load_scale if self._phase.carries else np.zeros(10)
        return np.hstack([body * self._tare_scale, body * load, friction * self._friction_scale])

    def _innovation(self, rows: Array, row: MotionRow) -> tuple[Array, float]:
        """Return errors of prediction (n,) [Nm], and the largest square over its variance."""
        belief = self._filter.belief
        error = row.torque - rows @ belief.mean
        spread = np.einsum('ij,jk,ik->i', rows, belief.covariance, rows)
        return error, float(np.max(error**2 / (self._variance(row) + spread)))

    def _variance(self, row: MotionRow) -> Array:
        """Return the variance (n,) [Nm^2] of what noise, dry friction and the model leave."""
        return self._noise + row.doubt**2 + (self.settings.model_error * row.modelled) ** 2

    def _take(self, rows: Array, row: MotionRow, error: Array, now: float) -> None:
        variance = self._variance(row)
        large = error**2 / (_LARGEST**2 * variance)
        variance = self._repeated / self._period * variance * np.maximum(1.0, large)
        if (row.doubt**2 < self._noise).any():
            self._bare_time += self._period
        self._history.append(self._filter.belief)
        self._filter.update(rows, row.torque, variance, self._kept(now))

    def _kept(self, now: float) -> Array:
        """Return what is kept of the information, for each parameter."""
        s, kept = self.settings, np.ones(20 + len(self._friction))
        if now - self._phase.since < _FAST:
            return kept
        # While something is carried nothing is learnt of the arm without.
        kept[_LOAD if self._phase.carries else _TARE] = np.exp(-self._period / s.memory)
        kept[20:] = np.exp(-self._period / s.friction_memory)
        return kept

    def _measure_noise(self, error: Array, rows: Array, row: MotionRow) -> None:
        """Follow the torque that stays unexplained, where its friction is known."""
        square = np.minimum(error**2, _LARGEST**2 * self._noise)
        share = np.where(row.doubt**2 > 0.1 * self._noise, 0.0, self._period / _NOISE_TIME)
        least = (_LEAST_NOISE * self.settings.torque_noise) ** 2
        self._noise = np.maximum(self._noise + share * (square - self._noise), least)

    # Changes.

    def _change_found(self, now: float) -> None:
        if self._history:
            self._filter.belief = self._history[0]
        self._history.clear()
        self._change.reset()
        if self._phase.carries:
            self._found = now
        elif self.is_tared:
            self._begin(True, now)
        else:
            self._fault = (
                'the arm carried a payload at the start, or its model is wrong: start without a '
                'payload and move, set payload.inertial_parameters, or identify the arm'
            )

    def _decide(self, rows: Array, row: MotionRow, now: float) -> None:
        """See whether the arm without payload explains what is felt now."""
        assert self._found is not None
        bare = rows.copy()
        bare[:, _LOAD] = 0.0
        _, square = self._innovation(bare, row)
        self._quiet = self._quiet + self._period if square < 3.0 else 0.0
        if self._quiet >= 2.5 * PERIOD:
            self._begin(False, now)
        elif now - self._found > _DECISION:
            self._begin(True, now)

    def _begin(self, carries: bool, now: float) -> None:
        self._filter.forget(_LOAD)
        self._phase = _Phase(carries, now)
        self._found = None
        self._quiet = 0.0
        self._change.reset()
        self.changes += 1

    def _look_again(self, rows: Array, row: MotionRow) -> None:
        """Reset once the arm without payload explains the torques."""
        _, square = self._innovation(rows, row)
        self._quiet = self._quiet + self._period if square < 3.0 else 0.0
        if self._quiet > 1.0:
            self._start_anew()

    # What is told.

    def _tell(self, now: float) -> OnlineEstimate:
        belief, carries = self._filter.belief, self._phase.carries
        block, scale = (_LOAD, self._load_scale) if carries else (_TARE, self._tare_scale)
        covariance = belief.covariance[block, block] * np.outer(scale, scale)
        body = ball(SPECK, np.zeros(3), self.settings.payload_size)
        if carries:
            information = np.asarray(np.linalg.inv(covariance))
            body = nearest_body(scale * belief.mean[block], information, self.settings.payload_size)
        n = self._motion.n
        deviation = self._friction_scale * belief.mean[20:]
        spread = self._friction_scale * np.sqrt(np.diag(belief.covariance)[20:])
        self.estimate = OnlineEstimate(
            now,
            Payload(self.link, body, covariance),
            carries,
            self._phase.since,
            scale,
            (self._friction + deviation).reshape(3, n),
            spread.reshape(3, n),
            np.sqrt(self._noise),
        )
        return self.estimate


def _is_nothing(payload: Payload) -> bool:
    """Whether the body that was found explains no more than noise does."""
    body = payload.inertial
    return float(body @ np.linalg.solve(payload.covariance, body)) < _SIGNIFICANT**2
