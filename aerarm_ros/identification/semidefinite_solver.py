"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.compressed_columns import CompressedColumns
from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.prior import Prior
from aerarm_ros.identification.reduced_regression import TriangularSystem
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia

Array = npt.NDArray[np.float64]

# Smallest eigenvalue asked for, of the pseudo-inertia in units of the link's mass and size:
# the solver stops within 1e-8 of its constraints, and the result must be on the right side.
_MARGIN = 1e-6
# A printed link with motor, screws and cables weighs between half and twice its drawing.
MASS_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class PhysicalLimits:
    """What a real arm obeys.

    Attributes
    ----------
    mass : (n,) ndarray
        Masses according to CAD [kg].
    size : (n,) ndarray
        Lengths that make the pseudo-inertia's entries comparable [m].
    nonnegative : (p - 10 n,) ndarray of bool
        Which of the joints' coefficients cannot be negative.
    mass_factor : float
        Masses lie within this factor of `mass`, thesis (3.11).
    """

    mass: Array
    size: Array
    nonnegative: npt.NDArray[np.bool_]
    mass_factor: float = MASS_FACTOR


def solve_semidefinite(system: TriangularSystem, prior: Prior, limits: PhysicalLimits) -> Array:
    """Minimise torque error plus distance from the prior over all possible bodies.

    Every link's 4x4 pseudo-inertia matrix is positive definite (Wensing, Kim, Slotine,
    RA-L 2018), which thesis (3.9) with (3.15) does not ensure; friction and rotor inertia are
    not negative. The problem is convex: the solution is the global one.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance.
    prior : Prior
    limits : PhysicalLimits

    Returns
    -------
    (p,) ndarray

    Raises
    ------
    IdentificationError
        If the solver finds no solution.
    """
    import clarabel

    count, n = len(prior.mean), len(limits.mass)
    scale = prior.std
    # Unknowns: deviation from the prior in its standard deviations, and the residual, so that
    # R is never squared: min |x|^2 + |r|^2 with R (mean + scale x) + r = z.
    rows = system.R * scale
    quadratic = CompressedColumns.of(np.eye(2 * count))
    blocks = [np.hstack([rows, np.eye(count)])]
    offsets = [system.z - system.R @ prior.mean]
    cones: list[Any] = [clarabel.ZeroConeT(count)]
    bounds, bound_offsets = _bounds(prior, limits)
    blocks.append(np.hstack([-bounds, np.zeros((len(bounds), count))]))
    offsets.append(bound_offsets)
    cones.append(clarabel.NonnegativeConeT(len(bounds)))
    for link in range(n):
        columns, constant = _pseudo_inertia_cone(link, prior, limits)
        block = np.zeros((10, 2 * count))
        block[:, 10 * link : 10 * link + 10] = -columns
        blocks.append(block)
        offsets.append(constant)
        cones.append(clarabel.PSDTriangleConeT(4))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    if hasattr(settings, 'max_threads'):
        settings.max_threads = 1  # same input, same bits out
    solver = clarabel.DefaultSolver(
        quadratic,
        np.zeros(2 * count),
        CompressedColumns.of(np.vstack(blocks)),
        np.concatenate(offsets),
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in ('Solved', 'AlmostSolved'):
        raise IdentificationError(
            f'the semidefinite program ended with {solution.status}: check that masses and '
            'inertias of the URDF are plausible'
        )
    theta = prior.mean + scale * np.asarray(solution.x)[:count]
    return _inside(theta, limits)


def _bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0: masses within their factor, coefficients not negative."""
    n, count = len(limits.mass), len(prior.mean)
    rows, offsets = [], []
    for link, mass in enumerate(limits.mass):
        index = 10 * link
        for sign, limit in ((1.0, mass / limits.mass_factor), (-1.0, mass * limits.mass_factor)):
            row = np.zeros(count)
            row[index] = sign * prior.std[index] / mass
            rows.append(row)
            offsets.append(sign * (prior.mean[index] - limit) / mass)
    for index in (10 * n + np.flatnonzero(limits.nonnegative)).tolist():
        row = np.zeros(count)
        row[index] = 1.0
        rows.append(row)
        offsets.append(prior.mean[index] / prior.std[index])
    return np.array(rows), np.array(offsets)


def _pseudo_inertia_cone(link: int, prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return C, c such that the scaled pseudo-inertia's triangle is C x + c."""
    part = slice(10 * link, 10 * link + 10)
    length = np.array([1.0 / limits.size[link]] * 3 + [1.0])
    unit = np.outer(length, length) / limits.mass[link]
    columns = [_triangle(unit * pseudo_inertia(e)) for e in np.diag(prior.std[part])]
    constant = unit * pseudo_inertia(prior.mean[part]) - _MARGIN * np.eye(4)
    return np.column_stack(columns), _triangle(constant)


def _triangle(matrix: Array) -> Array:
    """Return the upper triangle, column by column, as the solver's cone has it."""
    rows, columns = np.triu_indices(4)
    order = np.lexsort((rows, columns))
    rows, columns = rows[order], columns[order]
    return np.asarray(matrix[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0)))


def _inside(theta: Array, limits: PhysicalLimits) -> Array:
    """Return the solution with rounding errors of the solver removed."""
    theta = theta.copy()
    start = 10 * len(limits.mass)
    signed = theta[start:]
    signed[limits.nonnegative] = np.maximum(signed[limits.nonnegative], 0.0)
    if minimum_eigenvalue(theta[:start].reshape(-1, 10)) < 0.0:
        raise IdentificationError(
            'the semidefinite program left its constraints: check the scale of the masses and '
            'inertias in the URDF'
        )
    return theta
