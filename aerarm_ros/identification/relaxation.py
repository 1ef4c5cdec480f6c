"""The semidefinite program with constraints given up in order where they contradict."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.prior import Prior
from aerarm_ros.identification.reduced_regression import TriangularSystem
from aerarm_ros.identification.semidefinite_solver import PhysicalLimits, solve_semidefinite

Array = npt.NDArray[np.float64]


def solve_relaxed(
    system: TriangularSystem, prior: Prior, limits: PhysicalLimits
) -> tuple[Array, tuple[str, ...]]:
    """Solve with the user's bounds, or with as many as can be met together.

    Thesis section 3.2.2 asks for a relaxation. Given up are, in this order, the bounds of the
    centres of mass (boxes are only roughly the links' hulls) and then the total mass. Masses
    near CAD and physical consistency are kept in any case: they can always be met.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance.
    prior : Prior
    limits : PhysicalLimits

    Returns
    -------
    theta : (p,) ndarray
    notes : tuple of str
        What was given up.

    Raises
    ------
    IdentificationError
        If there is no solution without these bounds either.
    """
    bounds = limits.bounds
    notes: list[str] = []
    while True:
        try:
            return solve_semidefinite(system, prior, replace(limits, bounds=bounds)), tuple(notes)
        except IdentificationError:
            if bounds.centres:
                bounds = replace(bounds, centres=False)
                notes.append('the bounds of the centres of mass cannot be met and were left out')
            elif bounds.total_mass is not None:
                low, high = bounds.total_mass
                bounds = replace(bounds, total_mass=None)
                notes.append(
                    f'the total mass {low:g} .. {high:g} kg cannot be met with masses within a '
                    f'factor {limits.mass_factor:g} of the URDF (together '
                    f'{limits.mass.sum():.4g} kg) and was left out'
                )
            else:
                raise
