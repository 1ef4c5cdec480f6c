"""Torques of the joints' terms in many states at once, smooth enough to be integrated."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import JointTerm, TermKind

Array = npt.NDArray[np.float64]

# A step of dry friction would make velocities chatter about zero: it is spread over this.
_WIDTH = 0.02  # [rad/s]
_SLOPE = 1e-4  # [rad/s] by which friction is differentiated
_INERTIA = (TermKind.ROTOR, TermKind.COUPLED_INERTIA)


class JointTorques:
    """Friction, rotors, offsets and couplings of n joints, with k coefficients.

    Parameters
    ----------
    model : JointModel
    """

    def __init__(self, model: JointModel) -> None:
        self._n = model.n
        self._terms = [
            (joint, joint if term.driver is None else term.driver, _spread(term))
            for joint, term in model.joint_columns
        ]

    def columns(self, dq: Array, ddq: Array, load: Array) -> Array:
        """Return the (W, n, k) torque per coefficient [Nm].

        Parameters
        ----------
        dq, ddq, load : (W, n) ndarray
            [rad/s], [rad/s^2], and magnitude of the torque on the links [Nm].
        """
        columns = np.zeros((*dq.shape, len(self._terms)))
        for k, (joint, moving, term) in enumerate(self._terms):
            columns[:, joint, k] = term.basis(dq[:, moving], ddq[:, moving], load[:, joint])
        return columns

    def without_inertia(self, columns: Array) -> Array:
        """Return columns of which those by acceleration are zero: they are part of the mass."""
        kept = [float(term.kind not in _INERTIA) for _, _, term in self._terms]
        return np.asarray(columns * np.array(kept))

    def inertia(self, values: Array) -> Array:
        """Return the (n, n) matrix by which accelerations cost torque [kg m^2]."""
        matrix = np.zeros((self._n, self._n))
        for value, (joint, moving, term) in zip(values, self._terms, strict=True):
            if term.kind in _INERTIA:
                matrix[joint, moving] += value
        return matrix

    def damping(self, values: Array, dq: Array, load: Array) -> Array:
        """Return the (W, n, n) derivative of the torque by velocities [Nms/rad]."""
        matrix = np.zeros((*dq.shape, self._n))
        still = np.zeros(len(dq))
        for value, (joint, moving, term) in zip(values, self._terms, strict=True):
            if term.kind not in _INERTIA:
                above, below = (
                    term.basis(dq[:, moving] + way * _SLOPE, still, load[:, joint])
                    for way in (0.5, -0.5)
                )
                matrix[:, joint, moving] += value * (above - below) / _SLOPE
        return matrix


def _spread(term: JointTerm) -> JointTerm:
    """Return a term without a step."""
    dry = (TermKind.COULOMB, TermKind.LOAD, TermKind.CREEP, TermKind.FORWARD, TermKind.BACKWARD)
    return replace(term, width=max(term.width, _WIDTH)) if term.kind in dry else term
