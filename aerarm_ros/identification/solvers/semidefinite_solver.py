"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from aerarm_ros.identification.arm_parameters import LinkBounds
from aerarm_ros.identification.errors import IdentificationError, SolverError
from aerarm_ros.identification.regression.base_parameters import LINK_SPREAD, Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import ConeProgram, PhysicalProgram, triangle
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


_FLAT = 1e-6  # eigenvalue of a scaled pseudo-inertia below which the body has no volume
_ROWS, _COLUMNS = np.tril_indices(4)
_DIAGONAL = np.flatnonzero(_ROWS == _COLUMNS)


def solve_entropic(
    system: TriangularSystem, prior: Prior, limits: PhysicalLimits, spread: float = LINK_SPREAD
) -> Array:
    """Minimize torque error plus the entropic divergence of the links from the prior.

    For a link with pseudo-inertia P, and P0 in the CAD model, the divergence is
    ``tr(P P0^-1) - log det(P P0^-1) - 4``, divided by the squared spread. The divergence equals
    twice the relative entropy of normal distributions with the covariances P and P0. The
    divergence is independent of the frame and the unit of length. Near CAD it is half the squared
    relative deviation, and it tends to infinity towards impossible bodies, so all links are
    physically consistent. Joint coefficients have the normal prior of `solve_semidefinite`. The
    problem is convex.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.
    prior : Prior
        Prior; of the links, only the mean of the inertial parameters is used.
    spread : float
        Relative deviation of a link from CAD that equals one standard deviation.

    Raises
    ------
    IdentificationError
        If a link of the CAD model has no extent, or the solver finds no solution.
    """
    count, links = len(prior.mean), len(limits.mass)
    # Further unknowns: for each link a lower triangle L and t <= log diag(L). With [S L; L'
    # diag(L)] >= 0 the sum of t is at most log det S.
    first, own = 2 * count, len(_ROWS) + 4
    program = PhysicalProgram(system, prior, limits, own * links)
    quadratic = np.zeros(first + own * links)
    quadratic[10 * links : first] = 1.0
    linear = np.zeros_like(quadratic)
    for link in range(links):
        columns, constant = program.scaled_pseudo_inertia(link)
        if np.linalg.eigvalsh(constant)[0] < _FLAT:
            raise IdentificationError(
                f'the entropic prior needs solid links, but the inertia of link {link + 1} in the '
                'URDF is not that of a solid body: correct it, or omit the solver'
            )
        part = slice(10 * link, 10 * link + 10)
        linear[part] = np.einsum('ijk,kj->i', columns, np.linalg.inv(constant)) / spread**2
        lower = first + own * link
        logarithms = slice(lower + len(_ROWS), lower + own)
        linear[logarithms] = -1.0 / spread**2
        _add_determinant(program, columns, constant, 10 * link, lower)
    return program.parameters(quadratic, linear)


def _add_determinant(
    program: ConeProgram, columns: Array, constant: Array, first: int, lower: int
) -> None:
    """Add the cones of one link, with x starting at `first`, and L and t at `lower`."""

    def block(upper_left: Array, triangular: Array) -> Array:
        corner = np.diag(np.diag(triangular))
        return triangle(np.block([[upper_left, triangular], [triangular.T, corner]]))

    none = np.zeros((4, 4))
    rows = np.zeros((36, lower - first + len(_ROWS)))
    rows[:, :10] = np.column_stack([block(column, none) for column in columns])
    for index, (row, column) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
        unit = none.copy()
        unit[row, column] = 1.0
        rows[:, lower - first + index] = block(none, unit)
    program.add('PSDTriangleConeT', -rows, block(constant, none), dimension=8, first=first)
    for index, place in enumerate(_DIAGONAL):
        # (t, 1, L_ii) in the exponential cone: exp(t) <= L_ii.
        exponential = np.zeros((3, len(_ROWS) + 4))
        exponential[0, len(_ROWS) + index] = exponential[2, place] = -1.0
        program.add('ExponentialConeT', exponential, np.array([0.0, 1.0, 0.0]), first=lower)
