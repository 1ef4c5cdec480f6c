"""Condition number of the regressor."""

from __future__ import annotations

import numpy as np
import scipy

from aerarm_ros.excitation.design.design_criterion import information, information_gradient
from aerarm_ros.excitation.design.identifiable_space import IdentifiableSpace
from aerarm_ros.motion.float_array import FloatArray


class ConditionCriterion:
    """Logarithm of sigma_max / sigma_min over the non-zero singular values, thesis (5.2).

    Eigenvalues cross during a design, and where they do their extremes have no derivative. So
    the extremes are softened: log-sum-exp of sharpness rho, which overestimates the logarithm
    by at most log(r) / rho.

    Parameters
    ----------
    space : identifiable space of the columns.
    columns : which columns of the regressor count.
    scaled : take the base columns, each divided by its norm, rather than (5.2)'s columns as
        they are (Gautier, Khalil 1992 scale by prior parameters to the same end).
    sharpness : rho.
    """

    def __init__(
        self,
        space: IdentifiableSpace,
        columns: slice,
        scaled: bool = False,
        sharpness: float = 12.0,
    ) -> None:
        self._space = space
        self._columns = columns
        self._scaled = scaled
        self._sharpness = sharpness

    def evaluate(self, stacked: FloatArray) -> tuple[float, FloatArray]:
        """Return value and derivative; see `DesignCriterion`."""
        chosen = stacked[:, :, self._columns]
        value, by_information = (self._of_scaled if self._scaled else self._of_plain)(chosen)
        gradient = np.zeros_like(stacked)
        gradient[:, :, self._columns] = information_gradient(chosen, by_information)
        return value, gradient

    def condition_number(self, stacked: FloatArray) -> float:
        """Return sigma_max / sigma_min itself, not softened."""
        chosen = stacked[:, :, self._columns]
        if self._scaled:
            matrix = self._correlation(information(chosen))[0]
        else:
            matrix = self._space.basis.T @ information(chosen) @ self._space.basis
        eigenvalues = np.linalg.eigvalsh(matrix)
        return float(np.sqrt(eigenvalues[-1] / max(eigenvalues[0], np.finfo(float).tiny)))

    def _of_plain(self, chosen: FloatArray) -> tuple[float, FloatArray]:
        basis = self._space.basis
        value, derivative = self._soft_condition(basis.T @ information(chosen) @ basis)
        return value, basis @ derivative @ basis.T

    def _of_scaled(self, chosen: FloatArray) -> tuple[float, FloatArray]:
        matrix = information(chosen)
        correlation, norms = self._correlation(matrix)
        value, derivative = self._soft_condition(correlation)
        # Through C = D^-1 A D^-1 with D^2 = diag(A).
        inner = derivative / np.outer(norms, norms)
        inner -= np.diag((derivative * correlation).sum(axis=1) / norms**2)
        base = self._space.base_columns
        result = np.zeros_like(matrix)
        result[np.ix_(base, base)] = inner
        return value, result

    def _correlation(self, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        base = self._space.base_columns
        part = matrix[np.ix_(base, base)]
        norms = np.sqrt(np.diag(part))
        return part / np.outer(norms, norms), norms

    def _soft_condition(self, matrix: FloatArray) -> tuple[float, FloatArray]:
        """Return half the softened logarithm of the eigenvalue ratio and its derivative."""
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
