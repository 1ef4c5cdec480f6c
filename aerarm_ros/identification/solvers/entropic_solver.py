"""Physically consistent least squares with an entropic prior (Lee, Wensing, Park, T-RO 2020)."""

import numpy as np

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.regression.base_parameters import LINK_SPREAD, Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import ConeProgram, PhysicalProgram, triangle
from aerarm_ros.identification.solvers.estimate import PhysicalLimits
from aerarm_ros.motion.signals import Array

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
