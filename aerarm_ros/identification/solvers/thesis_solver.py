"""Solvers of the thesis: SLSQP and simulated annealing, thesis (3.6) to (3.15)."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from aerarm_ros.identification.model_fit import ModelFit
from aerarm_ros.identification.regression import TriangularSystem
from aerarm_ros.identification.solvers.estimate import PhysicalLimits, solver
from aerarm_ros.model.inertia import barycentric_inertia, from_pseudo_inertia, pseudo_inertia
from aerarm_ros.motion.signals import Array

# Smallest eigenvalue of an inertia, relative to mass and size, that counts as positive.
_MARGIN = 1e-4
_STRETCH = 0.3  # relative stretch of the initial bodies, in each direction
_SHIFT = 0.2  # shift of their centres of mass, relative to the link's size
_STEP = 1e-6  # relative step of numerical derivatives


@dataclass(frozen=True, eq=False)
class ThesisProblem:
    """Cost and constraints of thesis problem (3.11), for solvers without cone constraints.

    The barycentric inertia contains the factor 1/m that the printed (3.9) lacks. Its positive
    definiteness is not sufficient for a body: a solution may violate the triangle inequality of the
    principal moments, which only the semidefinite program enforces.

    Attributes
    ----------
    system : TriangularSystem
        Unweighted system, because (3.11) minimizes the plain torque error.
    start : (p,) ndarray
        CAD parameters, which satisfy all constraints.
    scale : (p,) ndarray
        Natural size of each parameter, for example a standard deviation of the prior.
    """

    system: TriangularSystem
    start: Array
    scale: Array
    limits: PhysicalLimits

    @classmethod
    def of(cls, fit: ModelFit, limits: PhysicalLimits) -> 'ThesisProblem':
        """Return the optimization problem of a fit; the fit's prior provides start and scale."""
        return cls(fit.regression.system(), fit.prior.mean, fit.prior.std, limits)

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.limits.mass)

    def cost(self, theta: Array) -> float:
        """Return the squared torque error divided by the squared torque, for the reduced data."""
        residual = self.system.R @ theta - self.system.z
        return float(residual @ residual / max(float(self.system.z @ self.system.z), 1e-300))

    def gradient(self, theta: Array) -> Array:
        """Return the (p,) derivatives of the cost by the parameters."""
        residual = self.system.R @ theta - self.system.z
        size = max(float(self.system.z @ self.system.z), 1e-300)
        return np.asarray(2.0 * (residual @ self.system.R) / size)

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds (p,) of the parameters.

        The bounds of inertia tensors are so wide that they only limit parameters that the motion
        does not excite.
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
        """Return the constraint values, scaled by mass and size; feasible if non-negative.

        Parameters
        ----------
        inertial : (..., n, 10) ndarray
            Inertial parameters with positive masses.

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

        A link's constraints depend only on its own parameters, and the total mass on the sum. The
        derivatives by one parameter of every link are therefore computed at once.
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
        """Return random, physically possible parameters (p,): altered bodies of the CAD model."""
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
    """Return the (..., 3) leading principal minors, all positive for a positive matrix."""
    second = matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]
    return np.stack([matrix[..., 0, 0], second, np.linalg.det(matrix)], axis=-1)


_STARTS = 4  # CAD and random starts
_ITERATIONS = 300
_TOLERANCE = 1e-9  # absolute tolerance of the cost, which is at most about one
_FEASIBLE = 1e-6


def solve_slsqp(problem: ThesisProblem, seed: int = 0) -> Array:
    """Return the best of several local solutions of thesis (3.11).

    Parameters
    ----------
    seed : int
        Seed of the random starting points, for reproducible results.

    Returns
    -------
    (p,) ndarray
        Feasible solution with the smallest cost; the CAD parameters if no solution is feasible.
    """
    random = np.random.default_rng(seed)
    best, least = problem.start, problem.cost(problem.start)
    for start in range(_STARTS):
        theta = _local(problem, problem.random_start(random) if start else problem.start)
        inertial = theta[: 10 * problem.n].reshape(-1, 10)
        feasible = problem.inequalities(inertial).min() >= -_FEASIBLE
        if feasible and problem.cost(theta) < least:
            best, least = theta, problem.cost(theta)
    return best


def _local(problem: ThesisProblem, start: Array) -> Array:
    """Return a local solution; the search uses parameters scaled by their typical magnitudes."""
    scale, links = problem.scale, 10 * problem.n
    lower, upper = problem.bounds()

    def slopes(x: Array) -> Array:
        inertial = problem.inequality_slopes((x * scale)[:links].reshape(-1, 10))
        joints = np.zeros((len(inertial), len(scale) - links))
        return np.hstack([inertial, joints]) * scale

    found = minimize(
        lambda x: problem.cost(x * scale),
        np.clip(start, lower, upper) / scale,
        jac=lambda x: problem.gradient(x * scale) * scale,
        bounds=list(zip(lower / scale, upper / scale, strict=True)),
        constraints={
            'type': 'ineq',
            'fun': lambda x: problem.inequalities((x * scale)[:links].reshape(-1, 10)),
            'jac': slopes,
        },
        method='SLSQP',
        options={'maxiter': _ITERATIONS, 'ftol': _TOLERANCE},
    )
    return np.asarray(np.clip(found.x * scale, lower, upper))


_CHAINS = 24  # independent searches in parallel
_SWEEPS = 600  # sweeps over all parameters
# First and last temperature, and penalty weights; the cost is at most about one.
_HOT, _COLD = 1e-2, 1e-8
_SOFT, _HARD = 1.0, 1e3
# Metropolis moves of one parameter mix fastest at about this acceptance rate.
_ACCEPTED = 0.44
_ADAPTATION = 0.1


def solve_annealing(problem: ThesisProblem, seed: int = 0, sweeps: int = _SWEEPS) -> Array:
    """Return the best of several random searches for the minimum of thesis (3.11).

    The method follows Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca (RA-L 2019): violated
    constraints are added to the cost with a weight that grows with each cooling step.

    Parameters
    ----------
    seed : int
        Random seed, for reproducible results.
    sweeps : int
        Number of times that every parameter is varied.

    Returns
    -------
    (p,) ndarray
        Feasible result with the smallest cost among the searches; the CAD parameters if no result
        is feasible.
    """
    search = _Search(problem, np.random.default_rng(seed))
    temperatures = np.geomspace(_HOT, _COLD, sweeps)
    for temperature, weight in zip(temperatures, np.geomspace(_SOFT, _HARD, sweeps), strict=True):
        search.sweep(float(temperature), float(weight))
    return search.best()


class _Search:
    """Chains of simulated annealing; each Metropolis move changes one parameter."""

    def __init__(self, problem: ThesisProblem, random: np.random.Generator) -> None:
        self._problem = problem
        self._random = random
        self._lower, self._upper = problem.bounds()
        starts = [problem.start] + [problem.random_start(random) for _ in range(_CHAINS - 1)]
        self._theta = np.clip(np.array(starts), self._lower, self._upper)
        size = np.linalg.norm(problem.system.z)
        self._columns = problem.system.R / max(float(size), 1e-150)
        self._target = problem.system.z / max(float(size), 1e-150)
        self._step = 0.1 * problem.scale

    def sweep(self, temperature: float, weight: float) -> None:
        """Try to change every parameter once, in random order."""
        theta, links = self._theta, 10 * self._problem.n
        residual = theta @ self._columns.T - self._target  # recomputed to limit rounding errors
        cost = (residual**2).sum(axis=1)
        violation = self._violation(theta)
        for k in self._random.permutation(theta.shape[1]):
            value = theta[:, k] + self._step[k] * self._random.standard_normal(len(theta))
            value = np.clip(value, self._lower[k], self._upper[k])
            moved = residual + (value - theta[:, k])[:, None] * self._columns[:, k]
            new_cost, new_violation = (moved**2).sum(axis=1), violation
            if k < links:
                tried = theta.copy()
                tried[:, k] = value
                new_violation = self._violation(tried)
            rise = new_cost - cost + weight * (new_violation - violation)
            accepted = rise < temperature * self._random.exponential(size=len(theta))
            theta[accepted, k] = value[accepted]
            residual[accepted], cost[accepted] = moved[accepted], new_cost[accepted]
            violation = np.where(accepted, new_violation, violation)
            self._step[k] *= np.exp(_ADAPTATION * (accepted.mean() - _ACCEPTED))

    def best(self) -> Array:
        """Return the feasible state with the least cost among the final states of all chains."""
        feasible = self._theta[self._violation(self._theta) <= _FEASIBLE]
        ends = [self._problem.start, *feasible]
        return np.array(min(ends, key=self._problem.cost))

    def _violation(self, theta: Array) -> Array:
        inertial = theta[:, : 10 * self._problem.n].reshape(len(theta), -1, 10)
        return np.asarray(np.maximum(-self._problem.inequalities(inertial), 0.0).sum(axis=1))


_TEXT = (
    'solver of the thesis, (3.11) with (3.9), (3.12) and (3.13), which does not ensure physically '
    'consistent links'
)


@solver('slsqp', f'{_TEXT}, by sequential quadratic programming', 4)
def _slsqp(fit: ModelFit, limits: PhysicalLimits) -> Array:
    return solve_slsqp(ThesisProblem.of(fit, limits))


@solver('annealing', f'{_TEXT}, by simulated annealing', 5)
def _annealing(fit: ModelFit, limits: PhysicalLimits) -> Array:
    return solve_annealing(ThesisProblem.of(fit, limits))
