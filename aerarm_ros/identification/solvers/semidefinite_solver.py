"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.sparse import csc_matrix

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import LinkBounds
from aerarm_ros.identification.model_fit import LINK_SPREAD, ModelFit, Prior
from aerarm_ros.identification.regression import TriangularSystem
from aerarm_ros.identification.solvers.estimate import LARGEST_LOAD_FRICTION, PhysicalLimits, solver
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia
from aerarm_ros.motion.signals import Array


class ConeProgram:
    """Cone program: quadratic objective in unknowns y; each `offset - rows y` lies in a cone.

    Parameters
    ----------
    count : int
        Number of unknowns.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._rows: list[Array] = []
        self._offsets: list[Array] = []
        self._cones: list[tuple[str, int | None]] = []

    def add(
        self, cone: str, rows: Array, offset: Array, dimension: int | None = None, first: int = 0
    ) -> None:
        """Add a cone constraint on consecutive unknowns, the first of which has the index `first`.

        Parameters
        ----------
        cone : str
            Name of a Clarabel cone.
        dimension : int, optional
            Dimension of the cone; by default the number of rows m.
        first : int
            Index of the unknown of the first column.
        """
        if not len(rows):
            return
        padded = np.zeros((len(rows), self._count))
        padded[:, first : first + rows.shape[1]] = rows
        self._rows.append(padded)
        self._offsets.append(offset)
        self._cones.append((cone, None if cone == 'ExponentialConeT' else dimension or len(rows)))

    def minimise(self, quadratic: Array, linear: Array) -> Array:
        """Return the y that minimizes `sum(quadratic y^2) / 2 + linear y`.

        Raises
        ------
        IdentificationError
            If no solution exists, or none was found.
        """
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        if hasattr(settings, 'max_threads'):
            settings.max_threads = 1  # one thread, for reproducible results
        cones = [(getattr(clarabel, name), dimension) for name, dimension in self._cones]
        solver = clarabel.DefaultSolver(
            csc_matrix(np.diag(quadratic)),
            linear,
            csc_matrix(np.vstack(self._rows)),
            np.concatenate(self._offsets),
            [cone() if dimension is None else cone(dimension) for cone, dimension in cones],
            settings,
        )
        solution = solver.solve()
        if str(solution.status) not in ('Solved', 'AlmostSolved'):
            raise IdentificationError(
                f'the semidefinite program ended with {solution.status}: check that masses and '
                'inertias of the URDF are plausible'
            )
        return np.asarray(solution.x)


def triangle(matrix: Array) -> Array:
    """Return the upper triangle of a symmetric matrix, column by column, as in PSD cones."""
    rows, columns = np.triu_indices(len(matrix))
    order = np.lexsort((rows, columns))
    rows, columns = rows[order], columns[order]
    return np.asarray(matrix[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0)))


class PhysicalProgram(ConeProgram):
    """Cone program over possible parameters; the caller adds the cones of the links.

    Unknowns are the deviation x from the prior in standard deviations, and the residual r. With r
    as unknown, R (mean + std x) + r = z is a constraint, and R is never squared. The further
    unknowns of the caller follow.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.
    further : int
        Number of further unknowns of the caller.

    Attributes
    ----------
    count : int
        Number of parameters p; x has the indices below p, r starts at p.
    """

    def __init__(
        self, system: TriangularSystem, prior: Prior, limits: PhysicalLimits, further: int = 0
    ) -> None:
        self.count = len(prior.mean)
        super().__init__(2 * self.count + further)
        self._prior = prior
        self._limits = limits
        equations = np.hstack([system.R * prior.std, np.eye(self.count)])
        self.add('ZeroConeT', equations, system.z - system.R @ prior.mean)
        for rows, offsets in _linear_bounds(prior, limits):
            self.add('NonnegativeConeT', -rows, offsets)

    def scaled_pseudo_inertia(self, link: int) -> tuple[Array, Array]:
        """Return the pseudo-inertia of a link, relative to mass and size, as a function of x.

        Returns
        -------
        columns : (10, 4, 4) ndarray
        constant : (4, 4) ndarray
            The matrix is `constant` plus the sum of x_i times `columns[i]`, where x contains the
            link's deviations from the prior in standard deviations.
        """
        part = slice(10 * link, 10 * link + 10)
        length = np.array([1.0 / self._limits.size[link]] * 3 + [1.0])
        unit = np.outer(length, length) / self._limits.mass[link]
        columns = unit * pseudo_inertia(np.diag(self._prior.std[part]))
        return columns, unit * pseudo_inertia(self._prior.mean[part])

    def parameters(self, quadratic: Array, linear: Array) -> Array:
        """Return the (p,) parameters at the minimum, without rounding errors of the solver.

        Parameters
        ----------
        quadratic, linear : (2 p + further,) ndarray
            Objective, as in `minimise`.

        Raises
        ------
        IdentificationError
            If the solver found no solution, or violated its constraints.
        """
        x = self.minimise(quadratic, linear)[: self.count]
        theta = self._prior.mean + self._prior.std * x
        start = 10 * len(self._limits.mass)
        signed, nonnegative = theta[start:], self._limits.nonnegative
        signed[nonnegative] = np.maximum(signed[nonnegative], 0.0)
        if self._limits.load is not None:
            load = self._limits.load
            signed[load] = np.minimum(signed[load], LARGEST_LOAD_FRICTION)
        if minimum_eigenvalue(theta[:start].reshape(-1, 10)) < 0.0:
            raise IdentificationError(
                'the solution of the semidefinite program violates its constraints: check the '
                'scale of the masses and inertias in the URDF'
            )
        return np.asarray(theta)


def _linear_bounds(prior: Prior, limits: PhysicalLimits) -> Iterator[tuple[Array, Array]]:
    """Yield pairs G, h of the constraints G x + h >= 0."""
    mean, unit, n = prior.mean, np.diag(prior.std), len(limits.mass)
    # Each mass is within a factor of its CAD value.
    masses, factor = slice(0, 10 * n, 10), limits.mass_factor
    relative, ratio = unit[masses] / limits.mass[:, None], mean[masses] / limits.mass
    yield np.vstack([relative, -relative]), np.concatenate([ratio - 1.0 / factor, factor - ratio])
    # Friction and rotor inertia are non-negative, and no gear loses more torque than it transmits.
    signed = 10 * n + np.flatnonzero(limits.nonnegative)
    yield np.eye(len(mean))[signed], mean[signed] / prior.std[signed]
    if limits.load is not None:
        load = 10 * n + np.flatnonzero(limits.load)
        yield -unit[load], LARGEST_LOAD_FRICTION - mean[load]
    if limits.bounds.total_mass is not None:  # thesis (3.13)
        whole = limits.mass.sum()
        row, total = unit[masses].sum(axis=0) / whole, mean[masses].sum() / whole
        low, high = limits.total_mass / whole
        yield np.array([row, -row]), np.array([total - low, high - total])
    if limits.bounds.centres:  # thesis (3.12)
        links = np.eye(len(mean))[: 10 * n].reshape(n, 10, -1)
        low, high = (links[:, 1:4] - box[..., None] * links[:, :1] for box in limits.centre_box)
        inside = np.array([low, -high]) / (limits.mass * limits.size)[:, None, None]
        rows = inside.reshape(6 * n, -1)
        yield rows * prior.std, rows @ mean


# Smallest allowed eigenvalue of the pseudo-inertia relative to the link's mass and size. The solver
# meets its constraints within 1e-8, and the result must be strictly feasible.
_MARGIN = 1e-6


def solve_semidefinite(system: TriangularSystem, prior: Prior, limits: PhysicalLimits) -> Array:
    """Minimize torque error plus distance from the prior over all physically possible parameters.

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
    """Solve with as many of the user's bounds as are compatible.

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
    wanted = limits.bounds
    tried = dict.fromkeys(
        LinkBounds(total, centres)
        for total in (wanted.total_mass, None)
        for centres in (wanted.centres, False)
    )
    for kept in tried:
        try:
            theta = solve(system, prior, replace(limits, bounds=kept))
            break
        except IdentificationError:
            if kept == LinkBounds():
                raise
    notes = []
    reason = 'bound ignored, because no solution was found that satisfies this bound'
    if wanted.centres and not kept.centres:
        notes.append(f'{reason}: the bounds of the centres of mass')
    if wanted.total_mass is not None and kept.total_mass is None:
        low, high = wanted.total_mass
        notes.append(
            f'{reason} with masses within a factor {limits.mass_factor:g} of the URDF (together '
            f'{limits.mass.sum():.4g} kg): the total mass {low:g} .. {high:g} kg'
        )
    return theta, tuple(notes)


_FLAT = 1e-6  # eigenvalue of a scaled pseudo-inertia below which the body has no volume
_ROWS, _COLUMNS = np.tril_indices(4)
_DIAGONAL = np.flatnonzero(_ROWS == _COLUMNS)


def solve_entropic(system: TriangularSystem, prior: Prior, limits: PhysicalLimits) -> Array:
    """Minimize torque error plus the entropic divergence of the links from the prior.

    For a link with pseudo-inertia P, and P0 in the CAD model, the divergence is
    ``tr(P P0^-1) - log det(P P0^-1) - 4``, divided by `LINK_SPREAD` squared. The divergence equals
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
        linear[part] = np.einsum('ijk,kj->i', columns, np.linalg.inv(constant)) / LINK_SPREAD**2
        lower = first + own * link
        logarithms = slice(lower + len(_ROWS), lower + own)
        linear[logarithms] = -1.0 / LINK_SPREAD**2
        _add_determinant(program, columns, constant, 10 * link, lower)
    return program.parameters(quadratic, linear)


def _add_determinant(
    program: ConeProgram, columns: Array, constant: Array, first: int, lower: int
) -> None:
    """Add the cones of one link, whose unknowns x begin at `first`, and L and t at `lower`."""

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


@solver('entropic', 'like sdp, but with an entropic prior that keeps links solid', 6)
def _entropic(fit: ModelFit, limits: PhysicalLimits) -> tuple[Array, tuple[str, ...]]:
    return solve_relaxed(
        fit.regression.system(fit.noise.weights), fit.prior, limits, solve_entropic
    )


@solver(
    'sdp',
    'semidefinite program with physically consistent links, close to CAD where the motion gives '
    'no information',
    7,
    is_fast=True,
)
def _sdp(fit: ModelFit, limits: PhysicalLimits) -> tuple[Array, tuple[str, ...]]:
    return solve_relaxed(fit.regression.system(fit.noise.weights), fit.prior, limits)
