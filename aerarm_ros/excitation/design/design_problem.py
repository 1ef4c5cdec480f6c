"""The design of a trajectory as a non-linear program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerarm_ros.excitation.design.design_constraints import DesignConstraints
from aerarm_ros.excitation.design.design_criterion import DesignCriterion
from aerarm_ros.excitation.design.smooth_regressor import SmoothRegressor
from aerarm_ros.excitation.design.state_basis import StateBasis
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


@dataclass
class _Point:
    """What is known about one coefficient vector."""

    key: bytes
    states: JointReference
    stacked: FloatArray
    effort: FloatArray
    value: float
    by_regressor: FloatArray
    constraints: FloatArray
    gradient: FloatArray | None = None
    jacobian: FloatArray | None = None


class DesignProblem:
    """Criterion and constraints, with derivatives, of a flat coefficient vector.

    All four functions share one evaluation, kept for the last vector asked for.

    Parameters
    ----------
    basis : from coefficients to states.
    regressor : from states to the regressor.
    criterion : what to make small, on the period.
    constraints : what to keep, on the period with run-in and run-out.
    prior : (p,) parameters known before, for the torque.
    """

    def __init__(
        self,
        basis: StateBasis,
        regressor: SmoothRegressor,
        criterion: DesignCriterion,
        constraints: DesignConstraints,
        prior: FloatArray,
    ) -> None:
        self.basis = basis
        self.regressor = regressor
        self._criterion = criterion
        self._constraints = constraints
        self._prior = prior
        self._last: _Point | None = None

    def value(self, x: FloatArray) -> float:
        """Return the criterion."""
        return self._at(x).value

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return the derivative of the criterion, like `x`."""
        return self._with_derivatives(x).gradient  # type: ignore[return-value]

    def constraints(self, x: FloatArray) -> FloatArray:
        """Return the constraints, >= 0 where feasible."""
        return self._at(x).constraints

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the derivative of the constraints, a row each."""
        return self._with_derivatives(x).jacobian  # type: ignore[return-value]

    def _at(self, x: FloatArray) -> _Point:
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

    def _with_derivatives(self, x: FloatArray) -> _Point:
        point = self._at(x)
        if point.gradient is None:
            by_state, effort_by_state = self._contract(point)
            point.gradient = self.basis.pull_back(*by_state).ravel()
            point.jacobian = self._jacobian(point, effort_by_state)
        return point

    def _contract(self, point: _Point) -> tuple[FloatArray, FloatArray]:
        """Return d value / d state (3, P, n) and d effort / d state (3, M, n, n).

        The regressor's derivative itself, (3 n, M, n, p), is never held as a whole.
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

    def _jacobian(self, point: _Point, effort_by_state: FloatArray) -> FloatArray:
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
