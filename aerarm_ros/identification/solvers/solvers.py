"""Registry of all solvers; all run on the same reduced regression."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from aerarm_ros.identification.arm_parameters import ArmParameters, LinkBounds, inertia_boxes
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import TermKind
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.solvers.estimate import Estimate, PhysicalLimits
from aerarm_ros.identification.solvers.least_squares_solver import solve_least_squares
from aerarm_ros.identification.solvers.semidefinite_solver import solve_entropic, solve_relaxed
from aerarm_ros.identification.solvers.thesis_solvers import (
    ThesisProblem,
    solve_annealing,
    solve_slsqp,
)
from aerarm_ros.motion.signals import Array

RECOMMENDED = 'sdp'
"""Name of the recommended solver, whose estimate is physically consistent."""

SOLVERS = ('cad', 'cad_friction', 'ols', 'wls', 'slsqp', 'annealing', 'entropic', RECOMMENDED)
"""Names of all solvers, in the order of the report's tables."""

ALWAYS = ('cad', 'cad_friction', 'ols', RECOMMENDED)
"""Solvers that always run, for comparison in the report."""

FAST = (*ALWAYS, 'wls')
"""Solvers that take milliseconds."""


def solve_all(
    fit: ModelFit,
    cad: ArmParameters,
    names: Collection[str] = FAST,
    progress: Callable[[str], None] | None = None,
    bounds: LinkBounds | None = None,
) -> dict[str, Estimate]:
    """Return the estimate of each solver.

    Parameters
    ----------
    fit : ModelFit
        Regression, prior and noise.
    cad : ArmParameters
        CAD parameters, which determine the physical limits.
    names : collection of str
        Solvers to run in addition to `ALWAYS`.
    progress : callable, optional
        Function that receives the name of each slow solver.
    bounds : LinkBounds, optional
        User's bounds, dropped if contradictory; the notes of the recommended estimate then say so.

    Raises
    ------
    IdentificationError
        If a solver is unknown, or a solver in `ALWAYS` has no solution. Other solvers without a
        solution are omitted, and the recommended estimate's notes give the reason.
    """
    unknown = [name for name in names if name not in SOLVERS]
    if unknown:
        raise IdentificationError(
            f'unknown solver {", ".join(unknown)}: choose from {", ".join(SOLVERS)}'
        )
    limits = physical_limits(fit, cad, bounds)
    solvers = _solvers(fit, limits)
    estimates: dict[str, Estimate] = {}
    failures: list[str] = []
    for name in SOLVERS:
        if name not in (*names, *ALWAYS):
            continue
        if progress is not None and name not in FAST:
            progress(name)
        begin = time.perf_counter()
        try:
            theta, notes = solvers[name]()
        except IdentificationError as error:
            if name in ALWAYS:
                raise
            failures.append(f'solver {name} was skipped: {error}')
            continue
        seconds = time.perf_counter() - begin
        estimates[name] = Estimate(name, fit.model, theta, seconds=seconds, notes=notes)
    recommended = _with_uncertainty(estimates[RECOMMENDED], fit)
    estimates[RECOMMENDED] = replace(recommended, notes=(*recommended.notes, *failures))
    return estimates


def _solvers(
    fit: ModelFit, limits: PhysicalLimits
) -> dict[str, Callable[[], tuple[Array, tuple[str, ...]]]]:
    """Return functions by solver name; each computes parameters, and notes for the user."""
    regression, prior, weights = fit.regression, fit.prior, fit.noise.weights
    return {
        'cad': lambda: (prior.mean, ()),
        'cad_friction': lambda: (_drawn_with_friction(fit, limits), ()),
        'ols': lambda: (solve_least_squares(regression, prior.mean), ()),
        'wls': lambda: (solve_least_squares(regression, prior.mean, weights), ()),
        'slsqp': lambda: (solve_slsqp(ThesisProblem.of(fit, limits)), ()),
        'annealing': lambda: (solve_annealing(ThesisProblem.of(fit, limits)), ()),
        'entropic': lambda: solve_relaxed(
            regression.system(weights), prior, limits, solve_entropic
        ),
        RECOMMENDED: lambda: solve_relaxed(regression.system(weights), prior, limits),
    }


def _drawn_with_friction(fit: ModelFit, limits: PhysicalLimits) -> Array:
    """Return the nominal parameters of links and rotors, with the best-fitting friction.

    Friction is fitted because a URDF often has none, which would make the comparison with CAD
    meaningless.
    """
    system = fit.regression.system(fit.noise.weights)
    rotors = np.array([term.kind is TermKind.ROTOR for _, term in fit.model.joint_columns])
    fitted = np.flatnonzero(np.append(np.zeros(10 * fit.model.n, dtype=bool), ~rotors))
    theta = np.where(np.isin(np.arange(len(fit.prior.mean)), fitted), 0.0, fit.prior.mean)
    if len(fitted):
        lower = np.where(limits.nonnegative[~rotors], 0.0, -np.inf)
        rest = system.z - system.R @ theta
        theta[fitted] = lsq_linear(system.R[:, fitted], rest, (lower, np.inf)).x
    return np.asarray(theta)


def physical_limits(
    fit: ModelFit, cad: ArmParameters, bounds: LinkBounds | None = None
) -> PhysicalLimits:
    """Return the limits of physically possible parameters."""
    scale = cad.inertial_scale()
    centre, reach = inertia_boxes(cad.inertial)
    terms = [term for _, term in fit.model.joint_columns]
    return PhysicalLimits(
        mass=cad.inertial[:, 0],
        size=scale[:, 1] / scale[:, 0],
        nonnegative=np.array([term.nonnegative for term in terms], dtype=bool),
        load=np.array([term.kind is TermKind.LOAD for term in terms], dtype=bool),
        centre=centre,
        reach=reach,
        bounds=bounds or LinkBounds(),
    )


def _with_uncertainty(estimate: Estimate, fit: ModelFit) -> Estimate:
    """Add standard deviations to an estimate, from prior and data, without constraints.

    A coefficient at its bound, within the solver's accuracy, is set to 0.
    """
    variance = np.diag(fit.covariance)
    determined = np.clip(1.0 - variance / fit.prior.std**2, 0.0, 1.0)
    known = replace(estimate, std=np.sqrt(variance), determined=determined)
    return replace(known, theta=np.where(known.held_at_zero, 0.0, known.theta))
