"""Least-squares solver for the base parameters, thesis section 3.2."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.base_parameters import find_base_parameters
from aerarm_ros.identification.regression.regression import ReducedRegression
from aerarm_ros.motion.signals import Array


def solve_least_squares(
    regression: ReducedRegression, reference: Array, weights: npt.ArrayLike = 1.0
) -> Array:
    """Minimize the torque error without constraints.

    Only base parameters have a unique solution. The returned parameter vector has the optimal
    base parameters; all dependent parameters are those of the reference. The solution has the
    smallest possible torque error, but may be physically impossible.

    Parameters
    ----------
    reference : (p,) ndarray
        Reference parameters, usually CAD.
    weights : float or (n,) array_like
        Factors of each joint's rows, one over its noise [1/Nm]; 1 is ordinary least squares.

    Returns
    -------
    (p,) ndarray
    """
    base = find_base_parameters(regression.system().R, regression.columns)
    system = regression.system(weights)
    reduced = system.R[:, base.independent]
    scale = np.linalg.norm(reduced, axis=0)
    values, *_ = np.linalg.lstsq(reduced / scale, system.z, rcond=None)
    return base.complete(values / scale, reference)
