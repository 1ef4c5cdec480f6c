"""Sequential least-squares quadratic programming with random restarts, thesis section 3.3."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.solvers.thesis_problem import ThesisProblem

Array = npt.NDArray[np.float64]

_STARTS = 4  # CAD and random ones
_ITERATIONS = 300
_TOLERANCE = 1e-9  # of the cost, which is at most about one
_FEASIBLE = 1e-6


def solve_slsqp(problem: ThesisProblem, seed: int = 0) -> Array:
    """Return the best of several local solutions of (3.11).

    Parameters
    ----------
    problem : ThesisProblem
    seed : int
        Of the random starting points: same seed, same result.

    Returns
    -------
    (p,) ndarray
        Of the solutions that obey the constraints the one with the least cost; CAD if none do.
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
    """Return a local solution, in units of the parameters' sizes."""
    from scipy.optimize import minimize

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
