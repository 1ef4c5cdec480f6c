"""Design criteria of an excitation, based on the information matrix of the parameters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array, JointReference

# random states of the numerical rank, several times the number of columns per joint
_STATES = 400
_SHARPNESS = 20.0  # of the penalty of the condition number


class SmoothRegressor:
    """Torque regressor of links, viscous friction, smoothed Coulomb friction and rotor inertia.

    The columns equal those of `Regressor(robot, rotor_inertia=True)`. The sign of the velocity is
    replaced by tanh(dq / width), which is differentiable.

    Parameters
    ----------
    robot : arm with n joints.
    width : velocity at which the smoothed sign reaches 0.76 [rad/s].
    """

    _STEP = 1e-6

    def __init__(self, robot: Robot, width: float = 0.1) -> None:
        self._regressor = Regressor(robot, rotor_inertia=True)
        self._n = robot.n
        self._width = width

    @property
    def thesis_columns(self) -> slice:
        """Slice of the regressor columns of thesis (3.6), which has no rotor inertia."""
        return slice(0, 12 * self._n)

    def stack(self, states: JointReference) -> Array:
        """Return the regressor (M, n, p) of (M, n) states."""
        n, joint = self._n, np.arange(self._n)
        stacked = np.zeros((len(states.q), n, 13 * n))
        stacked[:, :, : 10 * n] = self._regressor.stack_rigid(*states)
        stacked[:, joint, 10 * n + joint] = states.dq
        stacked[:, joint, 11 * n + joint] = np.tanh(states.dq / self._width)
        stacked[:, joint, 12 * n + joint] = states.ddq
        return stacked

    def derivatives(
        self, states: JointReference, stacked: Array
    ) -> Iterator[tuple[int, int, Array]]:
        """Yield the derivative (M, n, p) of the regressor by each entry of q, dq and ddq.

        The derivatives are forward differences. Only the position derivatives have an error
        (about 1e-6) that exceeds rounding errors.

        Yields
        ------
        kind, joint, derivative : derivative with respect to the position (kind 0), velocity (1)
            or acceleration (2) of the joint.
        """
        for kind in range(3):
            for joint in range(self._n):
                moved = [part.copy() for part in states]
                moved[kind][:, joint] += self._STEP
                yield kind, joint, (self.stack(JointReference(*moved)) - stacked) / self._STEP


@dataclass(frozen=True, eq=False)
class IdentifiableSpace:
    """Space of all parameter combinations that motions of the arm can identify.

    Parameters
    ----------
    basis : (p, r) orthonormal basis of the parameter combinations that any motion identifies; r
        is their number.
    base_columns : (r,) indices of well-conditioned columns that span the regressor (columns of
        the base parameters).
    """

    basis: Array
    base_columns: NDArray[np.intp]

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return int(self.basis.shape[1])

    @classmethod
    def of_regressor(
        cls, robot: Robot, regressor: SmoothRegressor, columns: slice
    ) -> IdentifiableSpace:
        """Compute the identifiable space numerically, from random states.

        Parameters
        ----------
        robot : robot whose position limits bound the random states.
        regressor : regressor of the arm.
        columns : columns to identify.
        """
        generator = np.random.default_rng(0)
        low = np.maximum(robot.position_min, -np.pi)
        high = np.minimum(robot.position_max, np.pi)
        size = (_STATES, robot.n)
        states = JointReference(
            generator.uniform(low, high, size),
            generator.normal(0.0, 2.0, size),
            generator.normal(0.0, 5.0, size),
        )
        stacked = regressor.stack(states)[:, :, columns]
        matrix = stacked.reshape(-1, stacked.shape[2])
        _, singular, rows = np.linalg.svd(matrix, full_matrices=False)
        rank = int((singular > 1e-9 * singular[0] * max(matrix.shape) ** 0.5).sum())
        norms = np.linalg.norm(matrix, axis=0)
        # A column that is zero except for rounding must not be scaled to a norm of one.
        scales = np.where(norms > 1e-9 * norms.max(), norms, np.inf)
        _, _, pivots = scipy.linalg.qr(matrix / scales, mode='economic', pivoting=True)
        return cls(rows[:rank].T, np.sort(pivots[:rank]))


def information_gradient(stacked: Array, by_information: Array) -> Array:
    """Return the derivative of a criterion by the regressor, from that by the information matrix.

    Parameters
    ----------
    stacked : regressor W, (M, n, p).
    by_information : symmetric derivative of the function with respect to A, (p, p).
    """
    return np.asarray(2.0 * (stacked @ by_information) / len(stacked))


def information(stacked: Array) -> Array:
    """Return the information matrix A = sum_k W_k^T W_k / M, (p, p)."""
    rows = stacked.reshape(-1, stacked.shape[2])
    return np.asarray(rows.T @ rows / len(stacked))


class ConditionCriterion:
    """Log condition number, thesis (5.2): log(sigma_max / sigma_min) of non-zero singular values.

    The largest and smallest eigenvalue are not differentiable where two eigenvalues cross. A
    log-sum-exp of sharpness rho therefore smooths both eigenvalues; it overestimates the logarithm
    by at most log(r) / rho.

    Parameters
    ----------
    space : identifiable space of the columns.
    columns : columns of the regressor to include.
    sharpness : parameter rho.
    """

    def __init__(self, space: IdentifiableSpace, columns: slice, sharpness: float = 12.0) -> None:
        self._basis = space.basis
        self._columns = columns
        self._sharpness = sharpness

    def evaluate(self, stacked: Array) -> tuple[float, Array]:
        """Return the log condition number and its derivative by the regressor."""
        chosen, basis = stacked[:, :, self._columns], self._basis
        value, derivative = self._soft_condition(basis.T @ information(chosen) @ basis)
        gradient = np.zeros_like(stacked)
        gradient[:, :, self._columns] = information_gradient(chosen, basis @ derivative @ basis.T)
        return value, gradient

    def condition_number(self, stacked: Array) -> float:
        """Return the exact condition number sigma_max / sigma_min, without smoothing."""
        chosen = stacked[:, :, self._columns]
        return _condition_number(self._basis.T @ information(chosen) @ self._basis)

    def _soft_condition(self, matrix: Array) -> tuple[float, Array]:
        """Return a smooth approximation of the log condition number, and the derivative."""
        eigenvalues, vectors = np.linalg.eigh(matrix)
        log = np.log(np.maximum(eigenvalues, np.finfo(float).tiny))
        rho = self._sharpness
        value = (
            0.5 * (scipy.special.logsumexp(rho * log) + scipy.special.logsumexp(-rho * log)) / rho
        )
        weights = (
            0.5
            * (scipy.special.softmax(rho * log) - scipy.special.softmax(-rho * log))
            / eigenvalues
        )
        return float(value), np.asarray((vectors * weights) @ vectors.T)


def scaled_condition_number(space: IdentifiableSpace, stacked: Array) -> float:
    """Return the condition number of the base columns of a regressor, each with a norm of one.

    Gautier and Khalil (1992) scale the columns by prior parameters instead.
    """
    matrix = information(stacked[:, :, space.base_columns])
    norms = np.sqrt(np.diag(matrix))
    return _condition_number(matrix / np.outer(norms, norms))


def _condition_number(matrix: Array) -> float:
    """Return the condition number of a regressor with this information matrix."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    return float(np.sqrt(eigenvalues[-1] / max(eigenvalues[0], np.finfo(float).tiny)))


class InformationCriterion:
    """Mean logarithm of the standard deviations of the base parameters, up to a constant.

    The criterion is -log det(V^T A V) / 2r, with the basis V of the identifiable space and the
    information matrix A of torques with given noise. Doubling every eigenvalue halves every
    variance, whatever units the parameters have.

    Parameters
    ----------
    space : identifiable space of all columns.
    noise : (n,) standard deviation of each joint's torque [Nm].
    """

    def __init__(self, space: IdentifiableSpace, noise: Array) -> None:
        self._basis = space.basis
        self._noise = noise

    def evaluate(self, stacked: Array) -> tuple[float, Array]:
        """Return the mean log standard deviation and its derivative by the regressor."""
        weighted = stacked / self._noise[:, np.newaxis]
        matrix = self._basis.T @ information(weighted) @ self._basis
        sign, log_determinant = np.linalg.slogdet(matrix)
        rank = len(matrix)
        if sign <= 0.0:
            return np.inf, np.zeros_like(stacked)
        by_information = -0.5 / rank * self._basis @ np.linalg.inv(matrix) @ self._basis.T
        gradient = information_gradient(weighted, by_information) / self._noise[:, np.newaxis]
        return float(-0.5 * log_determinant / rank), gradient


class DesignCriterion:
    """D-optimality plus twice a smooth penalty for condition numbers (5.2) above a limit.

    The penalty log(1 + exp(s (value - limit))) / s, with s = 20, is almost zero below the limit and
    rises with slope one above the limit.

    Parameters
    ----------
    information, condition : criterion to minimize, and log condition number to keep below the
        limit.
    limit : log condition number above which the penalty acts.
    """

    def __init__(
        self, information: InformationCriterion, condition: ConditionCriterion, limit: float
    ) -> None:
        self._information, self._condition, self._limit = information, condition, limit

    def evaluate(self, stacked: Array) -> tuple[float, Array]:
        """Return the criterion for one period, and its derivative by the regressor (M, n, p)."""
        value, gradient = self._information.evaluate(stacked)
        other, other_gradient = self._condition.evaluate(stacked)
        excess = _SHARPNESS * (other - self._limit)
        slope = float(np.exp(-np.logaddexp(0.0, -excess)))
        penalty = float(np.logaddexp(0.0, excess)) / _SHARPNESS
        return value + 2.0 * penalty, gradient + 2.0 * (slope * other_gradient)
