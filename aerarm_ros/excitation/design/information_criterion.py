"""D-optimality: the volume of the parameters' confidence ellipsoid."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.design.design_criterion import information, information_gradient
from aerarm_ros.excitation.design.identifiable_space import IdentifiableSpace
from aerarm_ros.motion.float_array import FloatArray


class InformationCriterion:
    """Mean logarithm of the base parameters' standard deviations, up to a constant.

    -log det(V^T A V) / 2r, with A the information of torques measured with given noise: half of
    it in every eigenvalue halves every variance, whatever the units of the parameters.

    Parameters
    ----------
    space : identifiable space of all columns.
    noise : (n,) standard deviation of each joint's torque [Nm].
    """

    def __init__(self, space: IdentifiableSpace, noise: FloatArray) -> None:
        self._basis = space.basis
        self._noise = noise

    def evaluate(self, stacked: FloatArray) -> tuple[float, FloatArray]:
        """Return value and derivative; see `DesignCriterion`."""
        weighted = stacked / self._noise[:, np.newaxis]
        matrix = self._basis.T @ information(weighted) @ self._basis
        sign, log_determinant = np.linalg.slogdet(matrix)
        rank = len(matrix)
        if sign <= 0.0:
            return np.inf, np.zeros_like(stacked)
        by_information = -0.5 / rank * self._basis @ np.linalg.inv(matrix) @ self._basis.T
        gradient = information_gradient(weighted, by_information) / self._noise[:, np.newaxis]
        return float(-0.5 * log_determinant / rank), gradient

    def standard_deviations(self, stacked: FloatArray, samples: int) -> FloatArray:
        """Return the Cramer-Rao bound of each column's identifiable part, (p,).

        Parameters
        ----------
        stacked : regressor (M, n, p) along the trajectory.
        samples : number of measured samples with independent noise.
        """
        weighted = stacked / self._noise[:, np.newaxis]
        matrix = self._basis.T @ information(weighted) @ self._basis
        covariance = self._basis @ np.linalg.inv(matrix) @ self._basis.T / samples
        return np.asarray(np.sqrt(np.diag(covariance)))
