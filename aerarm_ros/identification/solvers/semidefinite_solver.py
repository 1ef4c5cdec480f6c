"""Physically consistent least squares as a semidefinite program, thesis (3.11) with an LMI."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.prior import Prior
from aerarm_ros.identification.regression.reduced_regression import TriangularSystem
from aerarm_ros.identification.solvers.cone_program import triangle
from aerarm_ros.identification.solvers.physical_limits import PhysicalLimits
from aerarm_ros.identification.solvers.physical_program import PhysicalProgram

Array = npt.NDArray[np.float64]

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
