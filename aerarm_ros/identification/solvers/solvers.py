"""Run of all solvers on the same reduced regression."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import ArmParameters, LinkBounds, TermKind, inertia_boxes
from aerarm_ros.identification.model_fit import ModelFit
from aerarm_ros.identification.solvers.estimate import SOLVERS as SOLVERS
from aerarm_ros.identification.solvers.estimate import Estimate, PhysicalLimits

RECOMMENDED = 'sdp'
"""Name of the recommended solver, whose estimate is physically consistent."""

ALWAYS = ('cad', 'cad_friction', 'ols', RECOMMENDED)
"""Solvers that always run, for comparison in the report."""

DEFAULT = (*ALWAYS, 'wls')
"""Solvers that run by default."""

# Each of these modules adds its solvers to the table `SOLVERS`.
for _module in sorted(Path(__file__).parent.glob('*_solver.py')):
    importlib.import_module(f'{__package__}.{_module.stem}')


def check_solvers(names: Collection[str]) -> None:
    """Raise IdentificationError if a name is not the name of a solver."""
    unknown = [name for name in names if name not in SOLVERS]
    if unknown:
        raise IdentificationError(
            f'unknown solver {", ".join(unknown)}: choose from {", ".join(_ordered())}'
        )


def _ordered() -> list[str]:
    return sorted(SOLVERS, key=lambda name: SOLVERS[name].order)


def solve_all(
    fit: ModelFit,
    cad: ArmParameters,
    names: Collection[str] = DEFAULT,
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
    check_solvers(names)
    limits = physical_limits(fit, cad, bounds)
    estimates: dict[str, Estimate] = {}
    failures: list[str] = []
    for name in _ordered():
        if name not in (*names, *ALWAYS):
            continue
        if progress is not None and not SOLVERS[name].is_fast:
            progress(name)
        begin = time.perf_counter()
        try:
            theta, notes = SOLVERS[name].solve(fit, limits)
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
