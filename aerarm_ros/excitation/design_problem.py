"""Trajectory design as a nonlinear program: states, constraints and derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.criteria import DesignCriterion, SmoothRegressor
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.motion.signals import Array, JointReference

_SAMPLES = 40  # per period of the highest harmonic
# Distance [m] added to the required clearance, because links may be closer between samples.
_PAD = 0.003
# of the log-sum-exp of constraints; the largest of M samples is overestimated by at most
# log(M) / sharpness
_SHARPNESS = 100.0
_CANDIDATES = 12  # steps of the optimizer to check


class StateBasis:
    """Linear map from Fourier coefficients to the states of one period with run-in and run-out.

    The coefficient matrix X (1 + 2N, n) has one column per joint: bias, sine and cosine
    coefficients. Position, velocity and acceleration are linear in X, so the map consists of the
    states of trajectories with a single coefficient of one.

    Parameters
    ----------
    fundamental : frequency f0 [Hz].
    harmonics : number of harmonics N.
    n : number of joints.
    ramp_time : duration of run-in and run-out [s].
    """

    def __init__(self, fundamental: float, harmonics: int, n: int, ramp_time: float) -> None:
        self.fundamental = fundamental
        self.harmonics = harmonics
        self.n = n
        rows = 1 + 2 * harmonics
        identity = np.eye(rows)
        sine, cosine = slice(1, 1 + harmonics), slice(1 + harmonics, rows)
        unit = FourierTrajectory(fundamental, identity[0], identity[:, sine], identity[:, cosine])
        played = RampedExcitation(unit, 1, ramp_time)
        step = 1.0 / (fundamental * harmonics * _SAMPLES)
        self.period_samples = harmonics * _SAMPLES
        """Number of samples in the period; the samples of run-in and run-out follow."""
        ramp = np.linspace(0.0, ramp_time, max(int(ramp_time / step), 2))
        self.times: Array = np.concatenate(
            [
                ramp_time + step * np.arange(self.period_samples),
                ramp[:-1],
                played.duration - ramp[::-1][1:],
            ]
        )
        self._basis = played.evaluate(self.times)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (1 + 2N, n) of the matrix of Fourier coefficients."""
        return 1 + 2 * self.harmonics, self.n

    def coefficients(self, trajectory: FourierTrajectory) -> Array:
        """Return the coefficient matrix of a trajectory [rad]."""
        return np.vstack([trajectory.q0, trajectory.alpha.T, trajectory.beta.T])

    def trajectory(self, coefficients: Array) -> FourierTrajectory:
        """Return the trajectory of a coefficient matrix [rad]."""
        sine, cosine = np.split(coefficients[1:], 2)
        return FourierTrajectory(self.fundamental, coefficients[0], sine.T, cosine.T)

    def states(self, coefficients: Array) -> JointReference:
        """Return positions, velocities and accelerations (M, n) of a coefficient matrix."""
        return JointReference(*(basis @ coefficients for basis in self._basis))

    def pull_back(self, *gradients: Array) -> Array:
        """Convert a function's gradient by the states to its gradient by the coefficients.

        Parameters
        ----------
        gradients : (M, n) derivatives with respect to position, velocity and acceleration; trailing
            ones are optional.
        """
        parts = [
            basis[: len(gradient)].T @ gradient
            for basis, gradient in zip(self._basis, gradients, strict=False)
        ]
        return np.asarray(sum(parts))


class DesignConstraints:
    """Smooth constraints: one for each joint and kind of limit, and one for all clearances.

    The samples of each constraint are combined by the Kreisselmeier-Steinhauser function, a
    log-sum-exp that is never below the largest sample, so a satisfied constraint is satisfied at
    every sample. The constraints only guide the optimizer; `FeasibilityChecker` makes the final
    check.

    Parameters
    ----------
    limits : limits of position, velocity and acceleration.
    effort : (n,) torque limit [Nm], including the limit of motor current.
    clearance : distances to keep; None ignores collisions.
    """

    _CLEARANCE_SCALE = 0.1
    """Distance [m] in the clearance constraint that counts as much as a joint's full limit."""

    def __init__(
        self, limits: MotionLimits, effort: Array, clearance: ClearanceChecker | None
    ) -> None:
        low, high = limits.position_min, limits.position_max
        bounded = np.isfinite(low) & np.isfinite(high)
        self._centre = 0.5 * np.where(bounded, (low, high), 0.0).sum(axis=0)
        half_range = np.where(bounded, 0.5 * (high - low), np.inf)
        self._scales = (half_range, limits.velocity, limits.acceleration, effort)
        finite = np.isfinite(np.concatenate(self._scales))
        self.active = np.append(finite, [True] * (clearance is not None))
        """Mask of the constraints with a finite limit; other constraints are omitted."""
        self._clearance = clearance

    def values(self, states: JointReference, effort: Array, period: int) -> Array:
        """Return the constraint values, (4 n,) or (4 n + 1,), all >= 0 for a feasible motion.

        Parameters
        ----------
        states : (M, n) states, starting with the period.
        effort : (M, n) joint torques [Nm].
        period : number of samples of the period.
        """
        parts = [1.0 - self._join(ratio**2) for ratio in self._ratios(states, effort)]
        if self._clearance is not None:
            shortfall = self._shortfall(states.q[:period])
            parts.append(-np.atleast_1d(self._join(shortfall)))
        return np.concatenate(parts)

    def gradients(
        self, states: JointReference, effort: Array, period: int
    ) -> tuple[list[Array], Array | None]:
        """Return the derivatives of the constraints by the sampled states and torques.

        Returns
        -------
        joint : derivatives (M, n) of the n constraints of position, velocity, acceleration and
            torque, each with respect to the samples of the quantity that it limits.
        clearance : derivative (M, n) of the last constraint with respect to the positions, or None.
        """
        joint = [
            -2.0 * ratio / scale * scipy.special.softmax(_SHARPNESS * ratio**2, axis=0)
            for ratio, scale in zip(self._ratios(states, effort), self._scales, strict=True)
        ]
        if self._clearance is None:
            return joint, None
        clearance = np.zeros_like(states.q)
        clearance[:period] = self._clearance_gradient(states.q[:period])
        return joint, clearance

    def _ratios(self, states: JointReference, effort: Array) -> list[Array]:
        quantities = (states.q - self._centre, states.dq, states.ddq, effort)
        return [values / scale for values, scale in zip(quantities, self._scales, strict=True)]

    def _join(self, values: Array) -> Array:
        return np.asarray(scipy.special.logsumexp(_SHARPNESS * values, axis=0) / _SHARPNESS)

    def _shortfall(self, positions: Array) -> Array:
        """Return the scaled missing clearance (M,) of each posture; positive if too close."""
        assert self._clearance is not None
        margins = np.array([self._clearance.margin(q) for q in positions])
        return (_PAD - margins) / self._CLEARANCE_SCALE

    def _clearance_gradient(self, positions: Array) -> Array:
        assert self._clearance is not None
        weights = scipy.special.softmax(_SHARPNESS * self._shortfall(positions))
        gradient = np.zeros_like(positions)
        # Most postures are far from any obstacle and have no weight in the log-sum-exp.
        for sample in np.flatnonzero(weights > 1e-6):
            slope = self._clearance.margin_gradient(positions[sample])
            gradient[sample] = weights[sample] * slope / self._CLEARANCE_SCALE
        return gradient


class FeasibleIterates:
    """Record of the optimizer steps that satisfy the constraints.

    If the optimizer is stopped, or its optimum violates a limit between samples, an earlier
    iterate is often feasible and almost as good.
    """

    _TOLERANCE = 1e-3
    """Accepted violation of the constraints; harmless, because the constraints are conservative."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, int, Array]] = []
        self._count = 0
        self.last: Array | None = None
        """Coefficients of the optimizer's latest step, feasible or not."""

    def see(self, x: Array, value: float, constraints: Array) -> None:
        """Store a step of the optimizer if it satisfies the constraints.

        Parameters
        ----------
        x : coefficients of the iterate.
        value : objective, smaller is better.
        constraints : constraint values, >= 0 where feasible.
        """
        self._count += 1
        self.last = x.copy()
        if constraints.min(initial=0.0) >= -self._TOLERANCE:
            self._seen.append((value, self._count, self.last))

    def best(self) -> list[tuple[Array, int]]:
        """Return up to 12 stored steps, the best first, each with its number.

        Iterates near an optimum often violate the same limit, so the selection is spread over all
        iterates: the best iterate, then those with exactly 1, 2, 4, 8 and so on better iterates.
        """
        ranked = sorted(self._seen, key=lambda item: item[:2])
        chosen = [0, *(2**i for i in range(_CANDIDATES - 1))]
        return [(ranked[i][2], ranked[i][1]) for i in chosen if i < len(ranked)]


@dataclass
class _Point:
    """Coefficient vector of the last evaluation, and the results for this vector."""

    key: bytes
    states: JointReference
    stacked: Array
    effort: Array
    value: float
    by_regressor: Array
    constraints: Array
    gradient: Array | None = None
    jacobian: Array | None = None


class DesignProblem:
    """Criterion and constraints of a design, as functions of a vector of Fourier coefficients.

    All four functions share one evaluation, cached for the last vector.

    Parameters
    ----------
    basis : map from coefficients to states.
    regressor : map from states to the regressor.
    criterion : criterion to minimize, evaluated on one period.
    constraints : constraints, evaluated on one period with run-in and run-out.
    prior : (p,) prior parameters, from which the torque is computed.
    """

    def __init__(
        self,
        basis: StateBasis,
        regressor: SmoothRegressor,
        criterion: DesignCriterion,
        constraints: DesignConstraints,
        prior: Array,
    ) -> None:
        self.basis = basis
        self.regressor = regressor
        self._criterion = criterion
        self._constraints = constraints
        self._prior = prior
        self._last: _Point | None = None

    def value(self, x: Array) -> float:
        """Return the value of the criterion at the coefficients `x`."""
        return self._at(x).value

    def gradient(self, x: Array) -> Array:
        """Return the gradient of the criterion, with the shape of `x`."""
        return self._with_derivatives(x).gradient  # type: ignore[return-value]

    def constraints(self, x: Array) -> Array:
        """Return the constraint values, >= 0 where feasible."""
        return self._at(x).constraints

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian of the constraints, one row per constraint."""
        return self._with_derivatives(x).jacobian  # type: ignore[return-value]

    def _at(self, x: Array) -> _Point:
        key = x.tobytes()
        if self._last is None or self._last.key != key:
            states = self.basis.states(x.reshape(self.basis.shape))
            stacked = self.regressor.stack(states)
            effort = stacked @ self._prior
            period = self.basis.period_samples
            value, by_regressor = self._criterion.evaluate(stacked[:period])
            constraints = self._constraints.values(states, effort, period)
            constraints = constraints[self._constraints.active]
            self._last = _Point(key, states, stacked, effort, value, by_regressor, constraints)
        return self._last

    def _with_derivatives(self, x: Array) -> _Point:
        point = self._at(x)
        if point.gradient is None:
            by_state, effort_by_state = self._contract(point)
            point.gradient = self.basis.pull_back(*by_state).ravel()
            point.jacobian = self._jacobian(point, effort_by_state)
        return point

    def _contract(self, point: _Point) -> tuple[Array, Array]:
        """Return the derivatives of criterion (3, P, n) and torques (3, M, n, n) by q, dq and ddq.

        The regressor's derivative (3 n, M, n, p) is computed entry by entry, to limit the memory.
        """
        samples, n = point.states.q.shape
        period = self.basis.period_samples
        by_state = np.empty((3, period, n))
        effort_by_state = np.empty((3, samples, n, n))
        for kind, joint, derivative in self.regressor.derivatives(point.states, point.stacked):
            by_state[kind, :, joint] = np.einsum(
                'mjp,mjp->m', derivative[:period], point.by_regressor
            )
            effort_by_state[kind, :, joint] = derivative @ self._prior
        return by_state, effort_by_state

    def _jacobian(self, point: _Point, effort_by_state: Array) -> Array:
        joint, clearance = self._constraints.gradients(
            point.states, point.effort, self.basis.period_samples
        )
        rows = []
        n = self.basis.n
        for kind in range(3):
            for j in range(n):
                parts = np.zeros((kind + 1, *point.states.q.shape))
                parts[kind, :, j] = joint[kind][:, j]
                rows.append(self.basis.pull_back(*parts).ravel())
        for j in range(n):
            by_state = effort_by_state[:, :, :, j] * joint[3][:, j, np.newaxis]
            rows.append(self.basis.pull_back(*by_state).ravel())
        if clearance is not None:
            rows.append(self.basis.pull_back(clearance).ravel())
        return np.asarray(np.array(rows)[self._constraints.active])
