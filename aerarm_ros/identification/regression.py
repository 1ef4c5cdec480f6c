"""Regression of the torque of a bag: regressor columns, reduced by QR decomposition."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.uniform_motion import Samples, at_rest
from aerarm_ros.identification.joint_model import JointModel, JointTerm, TermKind, friction_state
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted torque of a bag, for one parameter vector.

    Attributes
    ----------
    filtered, raw : (M, n) ndarray
        Torque with and without low-pass filter [Nm], at the decimated samples.
    """

    filtered: Array
    raw: Array


class SampleColumns:
    """Regressor (thesis 3.6) of one bag, with the filter of the torque ("parallel filtering").

    The torque balance holds for filtered torque only if every column passes the same filter
    (Gautier, ICRA 1997). The columns contain higher frequencies than the motion, because they are
    products of signals, and dry friction is not smooth. Dry friction is evaluated at the fine
    rate, so that its steps keep their times.

    Parameters
    ----------
    regressor : Regressor
        Regressor of the arm.

    Attributes
    ----------
    motion : Samples
        Motion without repeated cycles, from which the columns are computed.
    rigid, rigid_raw : (M, n, 10 n) ndarray
        Columns of the links, with and without the torque's low-pass filter.
    weights : (n,) ndarray
        Weight of each joint's rows relative to other bags.
    """

    def __init__(self, samples: Samples, regressor: Regressor) -> None:
        self.samples = samples
        self.motion, self._place = motion, _ = samples.distinct()
        self._links = regressor.stack_rigid(motion.q, motion.dq, motion.ddq)
        self.rigid_raw = self.whole(self._links)
        self.rigid = self.whole(motion.coarse_filter(self._links))
        self._cache: dict[JointTerm, Array] = {}
        self._loads = np.zeros(0), np.zeros((0, samples.n))
        self._states: dict[float, Array] = {}
        self.weights = np.ones(samples.n)

    def altered(self, **values: Any) -> 'SampleColumns':
        """Return a copy of the bag with other `samples` of the same motion, or other `weights`."""
        other = copy(self)
        vars(other).update(values)
        return other

    def whole(self, columns: Array) -> Array:
        """Return columns (M, ...) for the whole motion from columns (K, ...) without repeats."""
        return columns if self._place is None else columns[self._place]

    def rate(self, term: JointTerm, inertial: Array | None = None) -> Array:
        """Return the time derivative (M, n) of a term's filtered column for every joint.

        Terms of another driving joint are not supported; arguments are those of `term`.
        """
        return self._columns(term, inertial, derivative=1)

    def _columns(
        self,
        term: JointTerm,
        inertial: Array | None,
        joints: slice | list[int] = slice(None),
        derivative: int = 0,
    ) -> Array:
        """Return the filtered columns of a term, or their time derivatives."""
        motion = self.motion
        if term.driver is not None:
            basis = term.basis(motion.dq[:, term.driver], motion.ddq[:, term.driver], None)
            return self.whole(motion.coarse_filter(basis, derivative)[:, None])
        if term.smooth:
            # Computed like the links' columns, so that rotor and link columns add up exactly.
            basis = term.basis(motion.dq, motion.ddq, None)
            return self.whole(motion.coarse_filter(basis, derivative))
        load = None
        if term.kind is TermKind.LOAD and inertial is not None:
            load = self._fine_loads(inertial)[:, joints]
        state = self._state(term)
        known = None if state is None else state[:, joints]
        basis = term.basis(motion.dq_fine[:, joints], motion.ddq_fine[:, joints], load, known)
        return self.whole(motion.fine_filter(basis, derivative))

    def term(self, term: JointTerm, inertial: Array | None = None) -> Array:
        """Return the regressor column of a joint term, for every joint.

        Parameters
        ----------
        inertial : (10 n,) ndarray, optional
            Inertial parameters that determine the load of a load-dependent term.

        Returns
        -------
        (M, n) ndarray
            Filtered torque per coefficient.
        """
        if term.kind is TermKind.LOAD:
            return self._columns(term, inertial)
        if term not in self._cache:
            columns = self._columns(term, inertial)
            self._cache[term] = np.broadcast_to(columns, self.samples.q.shape)
        return self._cache[term]

    def predict(self, model: JointModel, theta: Array) -> Prediction:
        """Return the torque predicted by `theta`; the links in `theta` also determine gear loads.

        Parameters
        ----------
        theta : (p,) ndarray
            Parameters in the order of `model.columns`.
        """
        samples = self.samples
        inertial = theta[: 10 * samples.n]
        links = self.links_torque(inertial)
        raw = model.torque(theta, links, samples.dq, samples.ddq, samples.q)
        filtered = self.rigid @ inertial
        for (joint, term), value in zip(model.joint_columns, theta[10 * samples.n :], strict=True):
            if term.kind is TermKind.LOAD:
                filtered[:, joint] += value * self._columns(term, inertial, [joint])[:, 0]
            else:
                filtered[:, joint] += value * self.term(term)[:, joint]
        return Prediction(filtered, raw)

    def links_torque(self, inertial: Array) -> Array:
        """Return the (M, n) unfiltered torque on the links [Nm] for (10 n,) parameters."""
        return self.whole(self._links @ inertial)

    def _fine_loads(self, inertial: Array) -> Array:
        """Return the magnitude (L, n) of the torque on the links at the fine samples [Nm]."""
        known, loads = self._loads
        if not np.array_equal(known, inertial):
            torque = self._links @ inertial
            fine = np.arange(len(self.motion.dq_fine), dtype=float)
            coarse = np.arange(len(torque), dtype=float) * self.samples.step
            columns = [np.interp(fine, coarse, own) for own in torque.T]
            loads = np.abs(np.column_stack(columns))
            self._loads = inertial.copy(), loads
        return loads

    def _state(self, term: JointTerm) -> Array | None:
        """Return the friction state (L, n) of a term at the fine samples; None without `distance`.

        Noise of the velocity at rest does not turn the joint, so the state lasts.
        """
        if not term.distance:
            return None
        if term.distance not in self._states:
            dq = self.motion.dq_fine
            travel = np.abs(dq) * self.motion.fine_filter.dt
            travel[at_rest(dq)] = 0.0
            self._states[term.distance] = friction_state(dq, travel, term.distance)
        return self._states[term.distance]

    def free_memory(self) -> None:
        """Drop intermediate signals of the fine samples, which are computed again if needed."""
        self.drop_loads()
        self._states.clear()

    def drop_loads(self) -> None:
        """Drop the stored loads at the fine samples, which depend on the parameters."""
        self._loads = np.zeros(0), np.zeros((0, self.samples.n))


@dataclass(frozen=True, eq=False)
class TriangularSystem:
    """Triangular problem `min ||R theta - z||`, equivalent to least squares with many rows.

    Attributes
    ----------
    R : (p, p) ndarray
        Upper triangular matrix.
    z : (p,) ndarray
        Right-hand side.
    """

    R: Array
    z: Array


@dataclass(frozen=True, eq=False)
class ReducedRegression:
    """Stacked regressor of thesis (3.8), reduced to one triangular factor per joint.

    A factor R of `[Phi_j tau_j] = Q R` preserves every inner product of its columns. The factors
    are therefore sufficient to compute any fit and any residual norm, with any weights of the
    joints. A problem of 80,000 rows becomes one of n (p + 1) rows with the same solution.

    Attributes
    ----------
    columns : tuple of str
        Names of the p parameters.
    factors : sequence of n arrays (rows_j, p + 1)
        Factors of the columns and, last, of the torque.
    rows : (n,) ndarray of int
        Number of samples per factor.
    """

    columns: tuple[str, ...]
    factors: Sequence[Array]
    rows: npt.NDArray[np.intp]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.factors)

    @property
    def torque_norms(self) -> Array:
        """Norm (n,) of each joint's torque [Nm]."""
        return np.array([np.linalg.norm(factor[:, -1]) for factor in self.factors])

    def column_norms(self) -> Array:
        """Return the norm of each column over the rows of each joint, (n, p)."""
        return np.array([np.linalg.norm(factor[:, :-1], axis=0) for factor in self.factors])

    def system(self, weights: npt.ArrayLike = 1.0) -> TriangularSystem:
        """Return the least-squares problem of all joints, with weighted rows.

        Parameters
        ----------
        weights : float or (n,) array_like
            Factors of each joint's rows, usually one over the noise [1/Nm].
        """
        weights = np.broadcast_to(np.asarray(weights, dtype=float), (self.n,))
        stacked = np.vstack([w * f for w, f in zip(weights, self.factors, strict=True)])
        factor = triangular_factor(stacked)
        count = len(self.columns)
        padded = np.zeros((count + 1, count + 1))
        padded[: len(factor)] = factor
        return TriangularSystem(padded[:count, :count], padded[:count, count])

    def residual_norms(self, theta: Array) -> Array:
        """Return the norm of each joint's torque residual (n,) [Nm], for parameters `theta`."""
        extended = np.append(-theta, 1.0)
        return np.array([np.linalg.norm(factor @ extended) for factor in self.factors])

    def error(self, theta: Array) -> float:
        """Return the torque error, thesis (5.3), over all rows [%], for parameters `theta`."""
        residual, torque = self.residual_norms(theta), self.torque_norms
        return float(100.0 * np.linalg.norm(residual) / np.linalg.norm(torque))


def triangular_factor(matrix: Array) -> Array:
    """Return the triangular factor R of `matrix = Q R`."""
    return np.asarray(np.linalg.qr(matrix, mode='r'))
