"""The constrained least-squares problem of thesis (3.11), with (3.9), (3.12) and (3.13)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.reduced_regression import TriangularSystem
from aerarm_ros.identification.solvers.physical_limits import PhysicalLimits
from aerarm_ros.model.inertia import barycentric_inertia, from_pseudo_inertia, pseudo_inertia

Array = npt.NDArray[np.float64]

# Least eigenvalue that "> 0" asks for, roughly, of an inertia in units of mass and size.
_MARGIN = 1e-4
_STRETCH = 0.3  # of the bodies to start from, in each direction
_SHIFT = 0.2  # of their centres of mass, in sizes of the link
_STEP = 1e-6  # of numerical derivatives, relative


@dataclass(frozen=True, eq=False)
class ThesisProblem:
    """Cost and constraints as functions of theta, for solvers that know no cones.

    The barycentric inertia has the factor 1/m that the printed (3.9) lacks. Its positive
    definiteness alone doesn't make a body: a solution may violate the triangle inequality of
    the principal moments, which only the semidefinite program excludes.

    Attributes
    ----------
    system : TriangularSystem
        Not weighted: (3.11) minimises the plain torque error.
    start : (p,) ndarray
        CAD, which obeys all constraints.
    scale : (p,) ndarray
        Natural size of each parameter, such as a standard deviation of the prior.
    limits : PhysicalLimits
    """

    system: TriangularSystem
    start: Array
    scale: Array
    limits: PhysicalLimits

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.limits.mass)

    def cost(self, theta: Array) -> float:
        """Return the squared torque error over the squared torque, both reduced."""
        residual = self.system.R @ theta - self.system.z
        return float(residual @ residual / max(float(self.system.z @ self.system.z), 1e-300))

    def gradient(self, theta: Array) -> Array:
        """Return the (p,) derivatives of the cost."""
        residual = self.system.R @ theta - self.system.z
        size = max(float(self.system.z @ self.system.z), 1e-300)
        return np.asarray(2.0 * (residual @ self.system.R) / size)

    def bounds(self) -> tuple[Array, Array]:
        """Return the (p,) least and largest values.

        Those of the inertias only keep what the motion doesn't excite from running away.
        """
        lower, upper = np.full((2, len(self.start)), np.inf)
        lower *= -1.0
        limits, count = self.limits, 10 * self.n
        lower[:count:10] = limits.mass / limits.mass_factor
        upper[:count:10] = limits.mass * limits.mass_factor
        reach = np.repeat(limits.mass_factor * limits.mass * limits.size**2, 6)
        inertia = np.arange(count).reshape(-1, 10)[:, 4:].ravel()
        lower[inertia], upper[inertia] = self.start[inertia] - reach, self.start[inertia] + reach
        lower[count:][limits.nonnegative] = 0.0
        return lower, upper

    def inequalities(self, inertial: Array) -> Array:
        """Return what must not be negative, in units of mass and size.

        Parameters
        ----------
        inertial : (..., n, 10) ndarray
            Of positive masses.

        Returns
        -------
        (..., 9 n + 2) ndarray
            For each link the leading minors of the barycentric inertia (3.9) and the distances
            of the first moment from the sides of the box (3.12), then the total mass (3.13).
        """
        limits = self.limits
        unit = limits.mass * limits.size
        tensor = barycentric_inertia(inertial) / (unit * limits.size)[:, None, None]
        low, high = limits.centre_box
        mass, moment = inertial[..., :1], inertial[..., 1:4]
        total = inertial[..., 0].sum(axis=-1, keepdims=True) / limits.mass.sum()
        least, most = limits.total_mass / limits.mass.sum()
        links = np.concatenate(
            [
                _leading_minors(tensor - _MARGIN * np.eye(3)),
                (moment - mass * low) / unit[:, None],
                (mass * high - moment) / unit[:, None],
            ],
            axis=-1,
        )
        flat = links.reshape(*links.shape[:-2], -1)
        return np.concatenate([flat, total - least, most - total], axis=-1)

    def inequality_slopes(self, inertial: Array) -> Array:
        """Return the (9 n + 2, 10 n) derivatives of `inequalities` at (n, 10) parameters.

        A link's constraints depend on its own parameters, the total mass on the sum: so one
        parameter of every link is varied at a time.
        """
        n = self.n
        slopes = np.zeros((9 * n + 2, n, 10))
        rows = np.arange(9 * n).reshape(n, 9)
        size = self.scale[: 10 * n].reshape(n, 10)
        for parameter in range(10):
            change = np.zeros((n, 10))
            change[:, parameter] = _STEP * size[:, parameter]
            ahead, behind = self.inequalities(np.stack([inertial + change, inertial - change]))
            difference = (ahead - behind)[: 9 * n].reshape(n, 9)
            slope = difference / (2.0 * change[:, parameter, None])
            slopes[rows, np.arange(n)[:, None], parameter] = slope
        total = self.limits.mass.sum()
        slopes[9 * n, :, 0], slopes[9 * n + 1, :, 0] = 1.0 / total, -1.0 / total
        return slopes.reshape(9 * n + 2, 10 * n)

    def random_start(self, random: np.random.Generator) -> Array:
        """Return a (p,) arm that could exist: CAD's matter stretched, shifted and made denser."""
        n, limits = self.n, self.limits
        change = np.tile(np.eye(4), (n, 1, 1))
        change[:, :3, :3] += _STRETCH * random.uniform(-1.0, 1.0, (n, 3, 3))
        shift = _SHIFT * limits.size[:, None] * random.uniform(-1.0, 1.0, (n, 3))
        change[:, :3, 3] = shift
        density = random.uniform(1.0 / limits.mass_factor, limits.mass_factor, (n, 1, 1))
        matter = pseudo_inertia(self.start[: 10 * n].reshape(n, 10))
        inertial = from_pseudo_inertia(density * change @ matter @ change.transpose(0, 2, 1))
        joints = self.start[10 * n :] * random.uniform(0.0, 2.0, len(self.start) - 10 * n)
        return np.concatenate([inertial.ravel(), joints])


def _leading_minors(matrix: Array) -> Array:
    """Return the (..., 3) leading principal minors, positive if the matrix is (Sylvester)."""
    second = matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]
    return np.stack([matrix[..., 0, 0], second, np.linalg.det(matrix)], axis=-1)
