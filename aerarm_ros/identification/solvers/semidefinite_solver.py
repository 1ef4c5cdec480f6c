"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from aerarm_ros.identification.arm_parameters import LinkBounds
from aerarm_ros.identification.errors import IdentificationError, SolverError
from aerarm_ros.identification.regression.base_parameters import Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import PhysicalProgram, triangle
from aerarm_ros.identification.solvers.estimate import PhysicalLimits
from aerarm_ros.motion.signals import Array

# Smallest eigenvalue asked for, of the pseudo-inertia in units of the link's mass and size:
# the solver stops within 1e-8 of its constraints, and the result must be on the right side.
_MARGIN = 1e-6


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
    program = PhysicalProgram(system, prior, limits)
    for link in range(len(limits.mass)):
        columns, constant = program.scaled_pseudo_inertia(link)
        constant = constant - _MARGIN * np.eye(4)
        cone = np.column_stack([triangle(column) for column in columns])
        program.add('PSDTriangleConeT', -cone, triangle(constant), dimension=4, first=10 * link)
    # The prior is normal and so is the noise: |x|^2 + |r|^2.
    return program.parameters(np.ones(2 * program.count), np.zeros(2 * program.count))


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
        return f'omitted, because it cannot be met{room}: {bound}'
    status = failure.status if isinstance(failure, SolverError) else 'inaccurate'
    return (
        f'omitted, because the solver failed with it ({status}), although it may be '
        f'feasible: {bound}'
    )
