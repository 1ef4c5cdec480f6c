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

# Smallest allowed eigenvalue of the pseudo-inertia relative to the link's mass and size. The solver
# meets its constraints within 1e-8, and the result must be strictly feasible.
_MARGIN = 1e-6


def solve_semidefinite(system: TriangularSystem, prior: Prior, limits: PhysicalLimits) -> Array:
    """Minimize torque error plus distance from the prior over all physically possible arms.

    Every link's 4x4 pseudo-inertia matrix is positive definite (Wensing, Kim, Slotine, RA-L 2018),
    which thesis (3.9) with (3.15) does not ensure; friction and rotor inertia are non-negative. The
    problem is convex, so the solution is the global minimum.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.

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
    # Prior and noise are both normal: |x|^2 + |r|^2.
    return program.parameters(np.ones(2 * program.count), np.zeros(2 * program.count))


def solve_relaxed(
    system: TriangularSystem,
    prior: Prior,
    limits: PhysicalLimits,
    solve: Callable[[TriangularSystem, Prior, PhysicalLimits], Array] = solve_semidefinite,
) -> tuple[Array, tuple[str, ...]]:
    """Solve with the user's bounds, without bounds that are contradictory.

    Thesis section 3.2.2 requires a relaxation. If the bounds are contradictory, the solver drops
    first the bounds of the centres of mass (boxes only approximate the links' hulls), then
    instead that of the total mass, then both. Masses near CAD and physical consistency are always
    kept, because they are always feasible.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.
    solve : callable
        Solver that applies the bounds in the limits.

    Returns
    -------
    theta : (p,) ndarray
    notes : tuple of str
        Dropped bounds, with the reason.

    Raises
    ------
    IdentificationError
        If no solution exists even without the user's bounds.
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
    """Yield sets of bounds to try, from all requested bounds to none."""
    wanted = limits.bounds
    totals = [None] if wanted.total_mass is None else [wanted.total_mass, None]
    if not _total_within_masses(limits):
        totals = [None]
    for total in totals:
        for centres in (True, False) if wanted.centres else (False,):
            yield LinkBounds(total, centres)


def _total_within_masses(limits: PhysicalLimits) -> bool:
    """Return whether the links' mass bounds allow the total mass, without calling a solver."""
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
    """Return why a bound was dropped; `failure` is None if no solver call was needed."""
    if failure is None or (isinstance(failure, SolverError) and failure.contradiction):
        return f'omitted, because it cannot be met{room}: {bound}'
    status = failure.status if isinstance(failure, SolverError) else 'inaccurate'
    return (
        f'omitted, because the solver failed with it ({status}), although it may be '
        f'feasible: {bound}'
    )
