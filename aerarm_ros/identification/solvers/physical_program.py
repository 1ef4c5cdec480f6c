"""What every semidefinite program over the parameters of an arm has in common."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.regression.prior import Prior
from aerarm_ros.identification.regression.reduced_regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import ConeProgram
from aerarm_ros.identification.solvers.physical_limits import LARGEST_LOAD_FRICTION, PhysicalLimits
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia

Array = npt.NDArray[np.float64]


class PhysicalProgram(ConeProgram):
    """A program over the parameters of a real arm; the cones of the links are left to its user.

    Unknowns are the deviation x from the prior in its standard deviations and the residual r, so
    that R is never squared: R (mean + std x) + r = z. Then come those of the user, if any.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance.
    prior : Prior
    limits : PhysicalLimits
    further : int
        Number of the user's own unknowns.

    Attributes
    ----------
    count : int
        Number of parameters p: x comes first, r from there on.
    """

    def __init__(
        self, system: TriangularSystem, prior: Prior, limits: PhysicalLimits, further: int = 0
    ) -> None:
        self.count = len(prior.mean)
        super().__init__(2 * self.count + further)
        self._prior = prior
        self._limits = limits
        equations = np.hstack([system.R * prior.std, np.eye(self.count)])
        self.add('ZeroConeT', equations, system.z - system.R @ prior.mean)
        linear = [_mass_bounds(prior, limits), _sign_bounds(prior, limits)]
        if limits.load is not None and limits.load.any():
            linear.append(_load_bounds(prior, limits, limits.load))
        if limits.bounds.total_mass is not None:
            linear.append(_total_mass_bounds(prior, limits))
        if limits.bounds.centres:
            linear.append(_centre_bounds(prior, limits))
        for rows, offsets in linear:
            self.add('NonnegativeConeT', -rows, offsets)

    def scaled_pseudo_inertia(self, link: int) -> tuple[Array, Array]:
        """Return the pseudo-inertia of a link in units of its mass and size.

        Returns
        -------
        columns : (10, 4, 4) ndarray
        constant : (4, 4) ndarray
            The matrix is `constant` plus the sum of x_i times `columns[i]`, x being the link's
            deviations from the prior in its standard deviations.
        """
        part = slice(10 * link, 10 * link + 10)
        length = np.array([1.0 / self._limits.size[link]] * 3 + [1.0])
        unit = np.outer(length, length) / self._limits.mass[link]
        columns = unit * pseudo_inertia(np.diag(self._prior.std[part]))
        return columns, unit * pseudo_inertia(self._prior.mean[part])

    def parameters(self, quadratic: Array, linear: Array) -> Array:
        """Return the (p,) parameters at the minimum, rounding errors of the solver removed.

        Parameters
        ----------
        quadratic, linear : (2 p + further,) ndarray
            The objective, as `minimise` has it.

        Raises
        ------
        IdentificationError
            If the solver found no solution, or did not keep its constraints.
        """
        x = self.minimise(quadratic, linear)[: self.count]
        theta = self._prior.mean + self._prior.std * x
        start = 10 * len(self._limits.mass)
        signed, nonnegative = theta[start:], self._limits.nonnegative
        signed[nonnegative] = np.maximum(signed[nonnegative], 0.0)
        if self._limits.load is not None:
            load = self._limits.load
            signed[load] = np.minimum(signed[load], LARGEST_LOAD_FRICTION)
        if minimum_eigenvalue(theta[:start].reshape(-1, 10)) < 0.0:
            raise IdentificationError(
                'the semidefinite program left its constraints: check the scale of the masses and '
                'inertias in the URDF'
            )
        return np.asarray(theta)


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


def _load_bounds(
    prior: Prior, limits: PhysicalLimits, load: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps a gear from losing more than it carries."""
    index = 10 * len(limits.mass) + np.flatnonzero(load)
    rows = np.zeros((len(index), len(prior.mean)))
    rows[np.arange(len(index)), index] = -prior.std[index]
    return rows, LARGEST_LOAD_FRICTION - prior.mean[index]
