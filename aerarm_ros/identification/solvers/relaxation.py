"""The semidefinite program with constraints given up in order where they contradict."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.link_bounds import LinkBounds
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.regression.prior import Prior
from aerarm_ros.identification.regression.reduced_regression import TriangularSystem
from aerarm_ros.identification.solvers.physical_limits import PhysicalLimits
from aerarm_ros.identification.solvers.semidefinite_solver import solve_semidefinite
from aerarm_ros.identification.solvers.solver_error import SolverError

Array = npt.NDArray[np.float64]


def solve_relaxed(
    system: TriangularSystem,
    prior: Prior,
    limits: PhysicalLimits,
    solve: Callable[[TriangularSystem, Prior, PhysicalLimits], Array] = solve_semidefinite,
) -> tuple[Array, tuple[str, ...]]:
    """Solve with the user's bounds, or with as many as can be met together.

    Thesis section 3.2.2 asks for a relaxation. Given up are, in this order, the bounds of the
    centres of mass (boxes are only roughly the links' hulls), the total mass, and both. Masses
    near CAD and physical consistency are kept in any case: they can always be met.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance.
    prior : Prior
    limits : PhysicalLimits
    solve : callable
        Solves with the bounds that the limits have.

    Returns
    -------
    theta : (p,) ndarray
    notes : tuple of str
        What was given up, and why.

    Raises
    ------
    IdentificationError
        If there is no solution without these bounds either.
    """
    failures: dict[LinkBounds, IdentificationError] = {}
    for bounds in _relaxations(limits):
        try:
            theta = solve(system, prior, replace(limits, bounds=bounds))
        except IdentificationError as error:
            failures[bounds] = error
            if bounds == LinkBounds():
                raise
        else:
            return theta, _notes(limits, bounds, failures)
    raise AssertionError('the last relaxation has no bounds')


def _relaxations(limits: PhysicalLimits) -> Iterator[LinkBounds]:
    """Yield bounds to try, from all that were asked for to none."""
    wanted = limits.bounds
    totals = [None] if wanted.total_mass is None else [wanted.total_mass, None]
    if not _total_within_masses(limits):
        totals = [None]
    for total in totals:
        for centres in (True, False) if wanted.centres else (False,):
            yield LinkBounds(total, centres)


def _total_within_masses(limits: PhysicalLimits) -> bool:
    """Return whether the links' own bounds leave room for the total: no solver is needed."""
    lightest, heaviest = limits.total_of_links
    return bool(limits.total_mass[0] <= heaviest and limits.total_mass[1] >= lightest)


def _notes(
    limits: PhysicalLimits,
    kept: LinkBounds,
    failures: Mapping[LinkBounds, IdentificationError],
) -> tuple[str, ...]:
    wanted = limits.bounds
    notes = []
    if wanted.centres and not kept.centres:
        failure = failures.get(replace(kept, centres=True))
        notes.append(_note('the bounds of the centres of mass', failure))
    if wanted.total_mass is not None and kept.total_mass is None:
        low, high = wanted.total_mass
        room = (
            f' with masses within a factor {limits.mass_factor:g} of the URDF (together '
            f'{limits.mass.sum():.4g} kg)'
        )
        failure = failures.get(LinkBounds(wanted.total_mass))
        notes.append(_note(f'the total mass {low:g} .. {high:g} kg', failure, room))
    return tuple(notes)


def _note(bound: str, failure: IdentificationError | None, room: str = '') -> str:
    """Return why a bound was given up; there is no failure if that was clear without trying."""
    if failure is None or (isinstance(failure, SolverError) and failure.contradiction):
        return f'left out as it cannot be met{room}: {bound}'
    status = failure.status if isinstance(failure, SolverError) else 'inaccurate'
    return f'left out as the solver failed with it ({status}), though it may be possible: {bound}'
