"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.link_bounds import LinkBounds
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.regression.prior import Prior
from aerarm_ros.identification.regression.reduced_regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import ConeProgram, triangle
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
    centre, reach : (n, 3) ndarray, optional
        Centres of mass according to CAD, and how far from there they may lie along each axis of
        the link's frame [m]. By default within `size` of the frame's origin.
    bounds : LinkBounds
        Which further constraints the program has.
    """

    mass: Array
    size: Array
    nonnegative: npt.NDArray[np.bool_]
    mass_factor: float = MASS_FACTOR
    centre: Array | None = None
    reach: Array | None = None
    bounds: LinkBounds = field(default_factory=LinkBounds)

    @property
    def centre_box(self) -> tuple[Array, Array]:
        """(n, 3) least and largest coordinates of the centres of mass (3.12) [m]."""
        centre = np.zeros((len(self.mass), 3)) if self.centre is None else self.centre
        reach = np.repeat(self.size[:, None], 3, axis=1) if self.reach is None else self.reach
        return centre - reach, centre + reach

    @property
    def total_mass(self) -> Array:
        """(2,) least and largest mass of all links together (3.13) [kg]."""
        if self.bounds.total_mass is not None:
            return np.array(self.bounds.total_mass)
        return np.asarray(self.mass.sum() * np.array([1.0 / self.mass_factor, self.mass_factor]))


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
    count = len(prior.mean)
    # Unknowns: the deviation x from the prior in its standard deviations, and the residual r,
    # so that R is never squared: min |x|^2 + |r|^2 with R (mean + std x) + r = z.
    program = ConeProgram(2 * count)
    constrain(program, system, prior, limits)
    for link in range(len(limits.mass)):
        columns, constant = scaled_pseudo_inertia(link, prior, limits)
        constant = constant - _MARGIN * np.eye(4)
        cone = np.column_stack([triangle(column) for column in columns])
        program.add('PSDTriangleConeT', -cone, triangle(constant), dimension=4, first=10 * link)
    x = program.minimise(np.ones(2 * count), np.zeros(2 * count))[:count]
    return checked(prior.mean + prior.std * x, limits)


def constrain(
    program: ConeProgram, system: TriangularSystem, prior: Prior, limits: PhysicalLimits
) -> None:
    """Add what the unknowns x, r of `solve_semidefinite` obey, but for the pseudo-inertias."""
    equations = np.hstack([system.R * prior.std, np.eye(len(prior.mean))])
    program.add('ZeroConeT', equations, system.z - system.R @ prior.mean)
    linear = [_mass_bounds(prior, limits), _sign_bounds(prior, limits)]
    if limits.bounds.total_mass is not None:
        linear.append(_total_mass_bounds(prior, limits))
    if limits.bounds.centres:
        linear.append(_centre_bounds(prior, limits))
    for rows, offsets in linear:
        program.add('NonnegativeConeT', -rows, offsets)


def scaled_pseudo_inertia(link: int, prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return the pseudo-inertia of a link in units of its mass and size.

    Returns
    -------
    columns : (10, 4, 4) ndarray
    constant : (4, 4) ndarray
        The matrix is `constant` plus the sum of x_i times `columns[i]`, x being the link's
        deviations from the prior in its standard deviations.
    """
    part = slice(10 * link, 10 * link + 10)
    length = np.array([1.0 / limits.size[link]] * 3 + [1.0])
    unit = np.outer(length, length) / limits.mass[link]
    columns = unit * pseudo_inertia(np.diag(prior.std[part]))
    return columns, unit * pseudo_inertia(prior.mean[part])


def checked(theta: Array, limits: PhysicalLimits) -> Array:
    """Return the solution with rounding errors of the solver removed.

    Raises
    ------
    IdentificationError
        If the solver did not keep its constraints.
    """
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


def _mass_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps the masses within their factor of CAD."""
    n = len(limits.mass)
    rows, offsets = np.zeros((2, n, len(prior.mean))), np.empty((2, n))
    links, masses = np.arange(n), 10 * np.arange(n)
    for side, sign, factor in ((0, 1.0, 1.0 / limits.mass_factor), (1, -1.0, limits.mass_factor)):
        rows[side, links, masses] = sign * prior.std[masses] / limits.mass
        offsets[side] = sign * (prior.mean[masses] / limits.mass - factor)
    return rows.reshape(2 * n, -1), offsets.ravel()


def _total_mass_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps the sum of the masses in its range (3.13)."""
    masses, unit = 10 * np.arange(len(limits.mass)), limits.mass.sum()
    row = np.zeros(len(prior.mean))
    row[masses] = prior.std[masses] / unit
    low, high = limits.total_mass / unit
    total = prior.mean[masses].sum() / unit
    return np.array([row, -row]), np.array([total - low, high - total])


def _centre_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps centres of mass in their boxes (3.12)."""
    rows, offsets = [], []
    for sign, box in zip((1.0, -1.0), limits.centre_box, strict=True):
        for link, corner in enumerate(box):
            for axis in range(3):
                row = np.zeros(len(prior.mean))
                row[10 * link + 1 + axis], row[10 * link] = sign, -sign * corner[axis]
                row /= limits.mass[link] * limits.size[link]
                rows.append(row * prior.std)
                offsets.append(float(row @ prior.mean))
    return np.array(rows), np.array(offsets)


def _sign_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps friction and rotor inertia from being negative."""
    index = 10 * len(limits.mass) + np.flatnonzero(limits.nonnegative)
    rows = np.zeros((len(index), len(prior.mean)))
    rows[np.arange(len(index)), index] = 1.0
    return rows, prior.mean[index] / prior.std[index]
