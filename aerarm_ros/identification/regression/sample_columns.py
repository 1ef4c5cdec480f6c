"""Regressor columns of one bag, as measured torque sees them: through the torque's filter."""

from copy import copy
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.samples import Samples
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import JointTerm, TermKind
from aerarm_ros.model.regressor import Regressor

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Torque that a parameter vector predicts for a bag.

    Attributes
    ----------
    filtered, raw : (M, n) ndarray
        With and without the torque's low-pass [Nm], at the decimated samples.
    """

    filtered: Array
    raw: Array


class SampleColumns:
    """Regressor (3.6) along one bag, filtered as the torque is ("parallel filtering").

    The torque balance holds for filtered torque only if every column passes the same filter
    (Gautier, ICRA 1997): products of smooth signals have frequencies above theirs, and dry
    friction is not smooth at all. Dry friction is evaluated at the fine rate, so that its
    steps are where they were.

    Parameters
    ----------
    samples : Samples
    regressor : Regressor
        Of the arm.

    Attributes
    ----------
    samples : Samples
    rigid, rigid_raw : (M, n, 10 n) ndarray
        The links' columns, with and without the torque's low-pass.
    weights : (n,) ndarray
        Of each joint's rows among those of other bags.
    """

    def __init__(self, samples: Samples, regressor: Regressor) -> None:
        self.samples = samples
        self.rigid_raw = regressor.stack_rigid(samples.q, samples.dq, samples.ddq)
        self.rigid = samples.coarse_filter(self.rigid_raw)
        self._cache: dict[JointTerm, Array] = {}
        self.weights = np.ones(samples.n)

    def with_samples(self, samples: Samples) -> 'SampleColumns':
        """Return the same columns with other torques: `samples` of the same motion."""
        other = copy(self)
        other.samples = samples
        return other

    def with_weights(self, weights: Array) -> 'SampleColumns':
        """Return the same bag that counts more or less, (n,) joint by joint."""
        other = copy(self)
        other.weights = weights
        return other

    def rate(self, term: JointTerm, inertial: Array | None = None) -> Array:
        """Return the time derivative of a term's filtered column for every joint, (M, n) [1/s].

        Not of a term that depends on another joint; parameters are those of `term`.
        """
        samples = self.samples
        if term.kind is TermKind.LOAD and inertial is not None:
            joints = range(samples.n)
            return np.column_stack([self._load_column(term, j, inertial, 1) for j in joints])
        if term.smooth:
            basis = term.basis(samples.dq, samples.ddq, None)
            return samples.coarse_filter(basis, derivative=1)
        basis = term.basis(samples.dq_fine, samples.ddq_fine, None)
        return samples.fine_filter(basis, derivative=1)

    def term(self, term: JointTerm, inertial: Array | None = None) -> Array:
        """Return a joint term's column for every joint.

        Parameters
        ----------
        term : JointTerm
        inertial : (10 n,) ndarray, optional
            Inertial parameters that give the load, for a term that depends on it.

        Returns
        -------
        (M, n) ndarray
            Filtered torque per coefficient.
        """
        if term.kind is TermKind.LOAD:
            if inertial is None:
                raise ValueError('friction that depends on the load needs inertial parameters')
            joints = range(self.samples.n)
            return np.column_stack([self._load_column(term, j, inertial) for j in joints])
        if term not in self._cache:
            samples = self.samples
            if term.driver is not None:
                basis = term.basis(samples.dq[:, term.driver], samples.ddq[:, term.driver], None)
                column = samples.coarse_filter(basis)[:, None]
                self._cache[term] = np.broadcast_to(column, samples.q.shape)
            elif term.smooth:
                # As the links' columns, so that a rotor's adds up with theirs to the last bit.
                self._cache[term] = samples.coarse_filter(term.basis(samples.dq, samples.ddq, None))
            else:
                self._cache[term] = samples.fine_filter(
                    term.basis(samples.dq_fine, samples.ddq_fine, None)
                )
        return self._cache[term]

    def predict(self, model: JointModel, theta: Array) -> Prediction:
        """Return the torque of a parameter vector; loads follow from its own links.

        Parameters
        ----------
        model : JointModel
        theta : (p,) ndarray
            In the order of `model.columns`.
        """
        samples = self.samples
        inertial = theta[: 10 * samples.n]
        raw = model.torque(theta, self.rigid_raw @ inertial, samples.dq, samples.ddq)
        filtered = self.rigid @ inertial
        for (joint, term), value in zip(model.joint_columns, theta[10 * samples.n :], strict=True):
            if term.kind is TermKind.LOAD:
                filtered[:, joint] += value * self._load_column(term, joint, inertial)
            else:
                filtered[:, joint] += value * self.term(term)[:, joint]
        return Prediction(filtered, raw)

    def links_torque(self, inertial: Array) -> Array:
        """Return the (M, n) torque on the links [Nm], not filtered, of (10 n,) parameters."""
        return np.asarray(self.rigid_raw @ inertial)

    def _load_column(
        self, term: JointTerm, joint: int, inertial: Array, derivative: int = 0
    ) -> Array:
        """Return the filtered column (M,) of a joint's load-dependent friction, or its rate."""
        samples = self.samples
        torque = self.rigid_raw[:, joint] @ inertial
        fine = np.arange(len(samples.dq_fine), dtype=float)
        coarse = np.arange(len(torque), dtype=float) * samples.step
        load = np.abs(np.interp(fine, coarse, torque))
        basis = term.basis(samples.dq_fine[:, joint], samples.ddq_fine[:, joint], load)
        return samples.fine_filter(basis, derivative)
