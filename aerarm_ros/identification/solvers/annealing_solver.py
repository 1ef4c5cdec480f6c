"""Simulated annealing with constraints as penalties, thesis section 3.3 and its reference [1]."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.solvers.thesis_problem import ThesisProblem

Array = npt.NDArray[np.float64]

_CHAINS = 24  # independent searches, moved at once
_SWEEPS = 600  # over all parameters
# Temperatures and weight of the penalties, first and last; the cost is at most about one.
_HOT, _COLD = 1e-2, 1e-8
_SOFT, _HARD = 1.0, 1e3
_FEASIBLE = 1e-6
# Metropolis moves of one parameter mix fastest if about this share is accepted.
_ACCEPTED = 0.44
_ADAPTATION = 0.1


def solve_annealing(problem: ThesisProblem, seed: int = 0, sweeps: int = _SWEEPS) -> Array:
    """Return the best arm of several random searches for the least of (3.11).

    As in Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca (RA-L 2019): violated constraints are
    added to the cost with a weight that grows from one cooling step to the next.

    Parameters
    ----------
    problem : ThesisProblem
    seed : int
        Same seed, same result.
    sweeps : int
        How often every parameter is tried.

    Returns
    -------
    (p,) ndarray
        The least cost among the searches that end within the constraints, or CAD.
    """
    search = _Search(problem, np.random.default_rng(seed))
    temperatures = np.geomspace(_HOT, _COLD, sweeps)
    for temperature, weight in zip(temperatures, np.geomspace(_SOFT, _HARD, sweeps), strict=True):
        search.sweep(float(temperature), float(weight))
    return search.best()


class _Search:
    """Chains of Metropolis moves; residuals are kept up to date, one column a move."""

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
        residual = theta @ self._columns.T - self._target  # anew, against rounding
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
        """Return the feasible end of least cost."""
        feasible = self._theta[self._violation(self._theta) <= _FEASIBLE]
        ends = [self._problem.start, *feasible]
        return np.array(min(ends, key=self._problem.cost))

    def _violation(self, theta: Array) -> Array:
        inertial = theta[:, : 10 * self._problem.n].reshape(len(theta), -1, 10)
        return np.asarray(np.maximum(-self._problem.inequalities(inertial), 0.0).sum(axis=1))
