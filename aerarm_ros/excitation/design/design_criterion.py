"""What makes an excitation good, as a function of the regressor along it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from aerarm_ros.motion.float_array import FloatArray


class DesignCriterion(Protocol):
    """A figure to be made small."""

    def evaluate(self, stacked: FloatArray) -> tuple[float, FloatArray]:
        """Return value and derivative (M, n, p) for the regressor (M, n, p) of one period."""
        ...


def information_gradient(stacked: FloatArray, by_information: FloatArray) -> FloatArray:
    """Return the derivative by the regressor W of a function of A = sum_k W_k^T W_k / M.

    Parameters
    ----------
    stacked : W, (M, n, p).
    by_information : symmetric derivative by A, (p, p).
    """
    return np.asarray(2.0 * (stacked @ by_information) / len(stacked))


def information(stacked: FloatArray) -> FloatArray:
    """Return A = sum_k W_k^T W_k / M, (p, p)."""
    rows = stacked.reshape(-1, stacked.shape[2])
    return np.asarray(rows.T @ rows / len(stacked))
