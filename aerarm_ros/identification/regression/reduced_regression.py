"""The regression problem reduced to triangular factors, columns named."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TriangularSystem:
    """A least-squares problem `min ||R theta - z||` equivalent to one of many more rows.

    Attributes
    ----------
    R : (p, p) ndarray
        Upper triangular.
    z : (p,) ndarray
    """

    R: Array
    z: Array


class ReducedRegression:
    """Rows of the stacked regressor (3.8), one triangular factor a joint.

    A factor R of `[Phi_j tau_j] = Q R` keeps every inner product of its columns, so any
    weighting of the joints, any fit and any residual norm follow from the factors alone: an
    80,000-row problem becomes one of n (p + 1) rows, solved exactly as well.

    Parameters
    ----------
    columns : sequence of str
        Names of the p parameters.
    factors : sequence of n arrays (rows_j, p + 1)
        Of the columns and, last, the torque.
    rows : (n,) array_like of int
        Samples behind each factor.
    """

    def __init__(
        self, columns: Sequence[str], factors: Sequence[Array], rows: npt.ArrayLike
    ) -> None:
        self.columns = tuple(columns)
        self.factors = tuple(factors)
        self.rows = np.asarray(rows, dtype=np.intp)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.factors)

    @property
    def torque_norms(self) -> Array:
        """(n,) norm of each joint's torque [Nm]."""
        return np.array([np.linalg.norm(factor[:, -1]) for factor in self.factors])

    def column_norms(self) -> Array:
        """Return the (n, p) norms of each joint's rows of every column."""
        return np.array([np.linalg.norm(factor[:, :-1], axis=0) for factor in self.factors])

    def system(self, weights: npt.ArrayLike = 1.0) -> TriangularSystem:
        """Return the problem of all joints together.

        Parameters
        ----------
        weights : float or (n,) array_like
            Factor of each joint's rows, usually one over its noise [1/Nm].
        """
        weights = np.broadcast_to(np.asarray(weights, dtype=float), (self.n,))
        stacked = np.vstack([w * f for w, f in zip(weights, self.factors, strict=True)])
        factor = triangular_factor(stacked)
        count = len(self.columns)
        padded = np.zeros((count + 1, count + 1))
        padded[: len(factor)] = factor
        return TriangularSystem(padded[:count, :count], padded[:count, count])

    def residual_norms(self, theta: Array) -> Array:
        """Return the (n,) norms of `tau_j - Phi_j theta` [Nm]."""
        extended = np.append(-theta, 1.0)
        return np.array([np.linalg.norm(factor @ extended) for factor in self.factors])

    def error(self, theta: Array) -> float:
        """Return the torque error (5.3) of all rows [%]."""
        residual, torque = self.residual_norms(theta), self.torque_norms
        return float(100.0 * np.linalg.norm(residual) / np.linalg.norm(torque))

    def select(self, names: Sequence[str]) -> 'ReducedRegression':
        """Return the regression with some of the columns only."""
        index = [self.columns.index(name) for name in names] + [len(self.columns)]
        factors = [triangular_factor(factor[:, index]) for factor in self.factors]
        return ReducedRegression(names, factors, self.rows)


def triangular_factor(matrix: Array) -> Array:
    """Return R of `matrix = Q R`."""
    return np.asarray(np.linalg.qr(matrix, mode='r'))
