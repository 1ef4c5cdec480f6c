"""Online estimation of payload and friction while the arm moves."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import positive
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

if TYPE_CHECKING:  # the solvers that this module imports take 0.3 s
    from aerarm_ros.identification.payload import Payload

FRICTION_NAMES = ('viscous [Nms/rad]', 'Coulomb [Nm]', 'load')
"""Names and units of the three rows of `OnlineEstimate.friction`."""

_UNKNOWN = 0.5  # of the prior's standard deviation


@dataclass(frozen=True, eq=False)
class OnlineEstimate:
    """Estimate of payload and friction from a `PayloadEstimator`.

    Attributes
    ----------
    time : float
        Time of the joint state from which the estimate follows [s].
    payload : Payload
        Payload beyond the arm's model; 1e-6 kg means none. The covariance is that before the
        constraint to physical bodies.
    carries : bool
        Whether the arm carries a payload.
    since : float
        Time [s] of the last detected pick-up or put-down; minus infinity before the first.
    prior_std : (10,) ndarray
        Standard deviations of the payload's parameters before any motion.
    friction, friction_std : (3, n) ndarray
        Present viscous [Nms/rad], Coulomb [Nm] and load-dependent friction [-] of the joints.
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
        """Names of the payload parameters that the motion hardly excites."""
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
        Bandwidth of the low-passes on both sides of the equation of motion [1/s]. Faster signals
        count as noise. The estimator notices a payload after some time constants of the low-passes.
    correlation_time : float
        Correlation time of model errors [s]. Errors within this time count as one error.
    payload_mass, payload_size : float
        Standard deviation of a payload's mass [kg], and the distance of its parts from the last
        joint [m].
    tare_mass : float
        Standard deviation of the mass error [kg] of the arm's model at the last link.
    friction_spread : float
        Relative standard deviation of the friction from its model.
    torque_noise : float
        Initial RMS torque [Nm] that the model leaves unexplained; measured from then on.
    model_error : float
        Relative standard deviation of gravity and inertia torques from the model. Torques within
        this deviation do not count as a change of the payload.
    memory, friction_memory : float
        Time constants of forgetting [s]: `memory` for payload and bias, `friction_memory` for
        friction.
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
        """Check that every setting of the estimator is positive."""
        for field in fields(self):
            positive(field.name, getattr(self, field.name))

    def body_scale(self, mass: float) -> np.ndarray:
        """Return prior standard deviations (10,) of a payload's parameters; `mass` is in kg."""
        size = self.payload_size
        return mass * np.array([1.0, *[size] * 3, *[size**2] * 6])


_ALLOWED = 5.0  # mean of squared errors over their variance, without a change
_THRESHOLD = 60.0  # sum above which a change is detected


class ChangeTest:
    """Cumulative sum test for errors that have become larger than expected.

    Page: Continuous inspection schemes (1954). The sum adds each squared error over its variance,
    minus an allowed value, up to a limit, so that a single outlier causes no detection.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Reset the cumulative sum."""
        self._sum = 0.0

    def update(self, square: float) -> bool:
        """Add a squared error divided by its variance; return whether the test detects a change."""
        self._sum = max(0.0, self._sum + min(square, 0.5 * _THRESHOLD) - _ALLOWED)
        return self._sum > _THRESHOLD


_FROZEN = 0.2  # [s] in which a signal of a moving joint changes
MOVING = 0.05
"""Speed [rad/s] above which a joint surely moves."""


class FrozenSignal:
    """Detector of joints that move while a measured signal stays exactly constant.

    Parameters
    ----------
    names : tuple of str
        Names of the joints.
    text : str
        Description of the problem, with two places for the joints' names and the constant value.

    Attributes
    ----------
    problem : str
        Description of the problem; empty if there is none.
    """

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self._names = names
        self._text = text
        self._before = np.full(len(names), np.nan)
        self._same = np.zeros(len(names))
        self.problem = ''

    def update(self, values: Array, dq: Array, dt: float) -> None:
        """Process signal values (n,) at velocities `dq`, `dt` [s] after the previous values."""
        is_same = values == self._before
        self._before = np.array(values)
        if not is_same.any() and not self.problem:
            self._same[:] = 0.0
            return
        self._same = np.where(is_same, self._same + dt * (np.abs(dq) > MOVING), 0.0)
        frozen = np.flatnonzero(self._same > _FROZEN)
        self.problem = ''
        if len(frozen):
            names = ', '.join(self._names[index] for index in frozen)
            self.problem = self._text.format(names, values[frozen[0]])


FROZEN_EFFORT = (
    'effort of {} stays at {:.3g} Nm while the joint moves: check that joint_states has measured '
    'torques'
)


PERIOD = 0.02
"""Shortest interval between two payload estimates [s]."""
# [s] A longer silence may hide any event.
_LONGEST_GAP = 0.05
_TARE, _LOAD = slice(0, 10), slice(10, 20)
_UNDONE = 0.3  # [s] before its detection in which a change may have happened
_SETTLING = 0.15  # [s] after a change in which the filter still contains earlier data
_DECISION = 0.35  # [s] after a change in which the test for a put-down decides
_FAST = 2.0  # [s] after a change without forgetting and without measuring noise
_TARE_TIME = 1.0  # [s] of motion without a sign of a payload, after which there is none
_SIGNIFICANT = 3.0  # standard deviations by which a payload must exceed zero
_NOISE_TIME = 3.0  # [s] over which the unexplained torque is measured
_LARGEST = 5.0  # standard deviations above which an error has less weight
_SMALL_SHARE = 0.02  # standard deviation of load-dependent friction if the model has none
_SMALL_FRICTION = 0.01  # [Nm], [Nms/rad]: standard deviation of other friction
_LEAST_NOISE = 0.25  # smallest noise, relative to the initial one


class PayloadEstimator:
    """Estimator of payload and friction, every 20 ms from joint states at 1 kHz.

    The estimator is a linear Bayesian filter with three blocks. The *bias* block is a body that
    corrects the arm's model at its last link, learnt without payload. The *payload* block has the
    same regressor columns and is learnt with a payload. The *friction* block follows friction's
    deviation from the model slowly. Only time separates bias and payload, so a constant model error
    does not enter the payload.

    A pick-up or put-down appears in the innovations. The filter sums up their squares over their
    variance (`ChangeTest`). After a detection, the filter restores its state from just before the
    change. The payload then either starts from its wide prior (the fast phase), or ends. The
    published payload is the physical body nearest to the payload block (`nearest_body`). So its 4x4
    pseudo-inertia is positive definite in every step.

    Parameters
    ----------
    dynamics : MovingBaseDynamics
        Model of the arm without payload.
    viscous, coulomb, load_share : (n,) array_like
        Known friction, see `FilteredMotion`.
    torque_noise : (n,) array_like, optional
        Initial RMS torque of each joint [Nm] that the model leaves unexplained; default: that of
        the settings for every joint.

    Attributes
    ----------
    estimate : OnlineEstimate or None
        The last valid estimate; None before the first.
    changes : int
        Number of detected pick-ups and put-downs.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        load_share: npt.ArrayLike,
        settings: EstimatorSettings | None = None,
        torque_noise: npt.ArrayLike | None = None,
    ) -> None:
        # imported before the first joint state, which must not wait for it
        from aerarm_ros.identification.payload import Payload

        self._payload = Payload
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
        self._efforts = FrozenSignal(dynamics.robot.joint_names, FROZEN_EFFORT)
        self._change = ChangeTest()
        # A persistent error is one error, not one per period.
        self._repeated = 2.0 * s.correlation_time
        self.estimate: OnlineEstimate | None = None
        self.changes = 0
        self._last: float | None = None
        noise = s.torque_noise if torque_noise is None else torque_noise
        self._noise = np.full(known.n, noise, dtype=float) ** 2
        self._least_noise = _LEAST_NOISE**2 * self._noise
        self._period, self._elapsed = PERIOD, 0.0
        self._start_anew()

    @property
    def problem(self) -> str:
        """Reason why payload estimation is impossible at present; empty without a problem."""
        return self._efforts.problem or self._fault

    @property
    def has_moved_empty(self) -> bool:
        """Whether the arm has moved for at least 1 s without a payload."""
        return self._bare_time >= _TARE_TIME

    def update(
        self, state: ArmState, now: float, base: BaseMotion | None = None
    ) -> OnlineEstimate | None:
        """Process a joint state at `now` [s]; return a new estimate, or None.

        A state with a missing number counts as lost. After a gap, or while there is a `problem`,
        the last valid estimate stays.

        Parameters
        ----------
        now : float
            Time of the state [s].
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
        self._efforts.update(state.tau, state.dq, now - last)
        if self._efforts.problem:
            self._motion.reset()
            return None
        self._elapsed += now - last
        if not self._motion.update(state, now - last, self._still if base is None else base):
            return None
        if self._elapsed < PERIOD - 1e-4 or not self._motion.is_settled:
            return None
        # States below 200 Hz make longer periods.
        self._period, self._elapsed = min(self._elapsed, _LONGEST_GAP + PERIOD), 0.0
        return self._learn(self._motion.row(), now)

    def pause(self) -> None:
        """Pause the estimation, because the base motion is unknown or an object holds the arm.

        The caller detects such an event late, so the last 0.3 s of learning are undone. Earlier
        data stay.
        """
        if self._history:
            self._filter.belief = self._history[0]
            self._history.clear()
            self._change.reset()
            if self.estimate is not None:
                self._new_estimate(self.estimate.time)
        self._interrupt()

    def _interrupt(self) -> None:
        """Restart the filters after missing joint states."""
        self._motion.reset()
        self._elapsed = 0.0
        self._last = None

    def _start_anew(self) -> None:
        self._filter = InformationFilter(20 + len(self._friction))
        self._carries, self._since = False, -np.inf
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
            return self._new_estimate(now)
        if self._rests(row):
            # A push at rest looks like a payload; a payload appears as soon as the arm moves.
            self._change.reset()
            return self._new_estimate(now)
        error, square = self._innovation(rows, row)
        if self._change.update(square):
            self._change_found(now)
            return None if self._fault else self._new_estimate(now)
        if now - self._since > _FAST:
            self._measure_noise(error, rows, row)
        if now - self._since > _SETTLING:
            self._take(rows, row, error, now)
        estimate = self._new_estimate(now)
        if estimate.carries and now - estimate.since > _FAST and _is_nothing(estimate.payload):
            # Another cause of the torque: a knock, or an error of the model.
            self._begin(False, now)
            estimate = self._new_estimate(now)
        return estimate

    def _rests(self, row: MotionRow) -> bool:
        """Return whether all joints rest; at rest, friction can hide or explain any torque."""
        n = self._motion.n
        return bool(np.abs(row.regressor[:, 10 : 10 + n]).max() < SLOW)

    def _rows(self, row: MotionRow) -> Array:
        """Return the regression rows of the n joint torques, in the scale of the filter."""
        body, friction = row.regressor[:, :10], row.regressor[:, 10:]
        load = self._load_scale if self._carries else np.zeros(10)
        return np.hstack([body * self._tare_scale, body * load, friction * self._friction_scale])

    def _innovation(self, rows: Array, row: MotionRow) -> tuple[Array, float]:
        """Return prediction errors (n,) [Nm], and the largest squared error over its variance."""
        belief = self._filter.belief
        error = row.torque - rows @ belief.mean
        spread = np.einsum('ij,jk,ik->i', rows, belief.covariance, rows)
        return error, float(np.max(error**2 / (self._variance(row) + spread)))

    def _variance(self, row: MotionRow) -> Array:
        """Return the torque variance (n,) [Nm^2] due to noise, dry friction and model errors."""
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
        """Return the fraction of the information that each parameter keeps in this period."""
        s, kept = self.settings, np.ones(20 + len(self._friction))
        if now - self._since < _FAST:
            return kept
        # With a payload, the bias of the bare arm is not learnt.
        kept[_LOAD if self._carries else _TARE] = np.exp(-self._period / s.memory)
        kept[20:] = np.exp(-self._period / s.friction_memory)
        return kept

    def _measure_noise(self, error: Array, rows: Array, row: MotionRow) -> None:
        """Update the noise estimate of joints whose friction is known."""
        square = np.minimum(error**2, _LARGEST**2 * self._noise)
        share = np.where(row.doubt**2 > 0.1 * self._noise, 0.0, self._period / _NOISE_TIME)
        self._noise = np.maximum(self._noise + share * (square - self._noise), self._least_noise)

    # Changes.

    def _change_found(self, now: float) -> None:
        if self._history:
            self._filter.belief = self._history[0]
        self._history.clear()
        self._change.reset()
        if self._carries:
            self._found = now
        elif self.has_moved_empty:
            self._begin(True, now)
        else:
            self._fault = (
                'the arm carried a payload at the start, or the model of the arm is wrong: start '
                'without a '
                'payload and move, set payload.inertial_parameters, or identify the arm'
            )

    def _decide(self, rows: Array, row: MotionRow, now: float) -> None:
        """Decide after a detected change whether the payload was put down or has changed."""
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
        self._carries, self._since = carries, now
        self._found = None
        self._quiet = 0.0
        self._change.reset()
        self.changes += 1

    def _look_again(self, rows: Array, row: MotionRow) -> None:
        """Restart the estimation once the model without payload explains the torques again."""
        _, square = self._innovation(rows, row)
        self._quiet = self._quiet + self._period if square < 3.0 else 0.0
        if self._quiet > 1.0:
            self._start_anew()

    # Published estimates.

    def _new_estimate(self, now: float) -> OnlineEstimate:
        belief, carries = self._filter.belief, self._carries
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
            self._payload(self.link, body, covariance),
            carries,
            self._since,
            scale,
            (self._friction + deviation).reshape(3, n),
            spread.reshape(3, n),
            np.sqrt(self._noise),
        )
        return self.estimate


def _is_nothing(payload: Payload) -> bool:
    """Return whether an estimated payload is insignificant, given its covariance."""
    body = payload.inertial
    return float(body @ np.linalg.solve(payload.covariance, body)) < _SIGNIFICANT**2
