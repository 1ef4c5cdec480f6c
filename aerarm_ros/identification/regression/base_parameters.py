"""Which combinations of parameters a motion identifies, thesis sections 3.2.1 and 5.3."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# The model's own dependencies are exact up to rounding; any excitation is far above this.
_RANK_TOLERANCE = 1e-8
_COEFFICIENT_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The smallest set of parameters that gives the same torques.

    Base parameter i is `theta[independent[i]] + combination[i] @ theta[dependent]`.

    Attributes
    ----------
    columns : tuple of str
        All p parameters.
    independent : (r,) ndarray of int
        Columns that no earlier columns give.
    dependent : (p - r,) ndarray of int
        The others, columns without any effect included.
    combination : (r, p - r) ndarray
        What the dependent parameters add to the independent ones.
    condition_number : float
        (5.2): largest over smallest singular value of the regressor that isn't zero.
    """

    columns: tuple[str, ...]
    independent: npt.NDArray[np.intp]
    dependent: npt.NDArray[np.intp]
    combination: Array
    condition_number: float

    @property
    def rank(self) -> int:
        """Rank r of the regressor."""
        return len(self.independent)

    def values(self, theta: Array) -> Array:
        """Return the (r,) base parameters of a parameter vector."""
        return np.asarray(theta[self.independent] + self.combination @ theta[self.dependent])

    def complete(self, values: Array, reference: Array) -> Array:
        """Return the parameter vector with these base parameters and a reference's others.

        Parameters
        ----------
        values : (r,) ndarray
            Base parameters.
        reference : (p,) ndarray
            Where the dependent parameters are taken from.
        """
        theta = np.array(reference, dtype=float)
        theta[self.independent] = values - self.combination @ theta[self.dependent]
        return theta

    def expressions(self) -> list[str]:
        """Return each base parameter as a sum, such as 'Izz_link1 + Ja_joint1'."""
        return [
            _expression(self.columns[column], row, [self.columns[d] for d in self.dependent])
            for column, row in zip(self.independent, self.combination, strict=True)
        ]


def find_base_parameters(factor: Array, columns: Sequence[str]) -> BaseParameters:
    """Separate independent from dependent columns of a triangular factor.

    Columns are taken in their order and orthogonalised: one that the earlier ones give
    completely is dependent. So the parameters of later links go into those of earlier ones.

    Parameters
    ----------
    factor : (p, p) ndarray
        R of the regressor, unweighted.
    columns : sequence of str
        Names of its columns.
    """
    independent, dependent = _split(factor)
    if len(independent) == 0:
        empty = np.zeros((0, len(dependent)))
        return BaseParameters(tuple(columns), independent, dependent, empty, float('inf'))
    solved = np.linalg.lstsq(factor[:, independent], factor[:, dependent], rcond=None)[0]
    combination: Array = np.asarray(solved)
    combination[np.abs(combination) < _COEFFICIENT_TOLERANCE] = 0.0
    singular = np.linalg.svd(factor, compute_uv=False)
    condition = float(singular[0] / singular[len(independent) - 1])
    return BaseParameters(tuple(columns), independent, dependent, combination, condition)


def _split(factor: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return independent and dependent columns by modified Gram-Schmidt, done twice."""
    norms = np.linalg.norm(factor, axis=0)
    basis = np.zeros((len(factor), 0))
    independent, dependent = [], []
    for column, norm in enumerate(norms):
        if norm <= _RANK_TOLERANCE * norms.max():
            dependent.append(column)
            continue
        left = factor[:, column] / norm
        for _ in range(2):
            left = left - basis @ (basis.T @ left)
        size = np.linalg.norm(left)
        if size <= _RANK_TOLERANCE:
            dependent.append(column)
        else:
            basis = np.column_stack([basis, left / size])
            independent.append(column)
    return np.array(independent, dtype=np.intp), np.array(dependent, dtype=np.intp)


def _expression(name: str, row: Array, names: Sequence[str]) -> str:
    parts = [name]
    for coefficient, other in zip(row, names, strict=True):
        if coefficient:
            size = abs(coefficient)
            factor = '' if abs(size - 1.0) < 1e-5 else f'{size:.4g} '
            parts.append(f'{"-" if coefficient < 0.0 else "+"} {factor}{other}')
    return ' '.join(parts)
