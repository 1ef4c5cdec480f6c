"""What is believed of the parameters before any data."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.regression.reduced_regression import ReducedRegression

Array = npt.NDArray[np.float64]

# Relative standard deviation of an inertial parameter: a drawing misses cables, screws and
# the infill of printed parts, but not half of a link.
LINK_SPREAD = 0.3
# Of a joint's coefficient, as a share of what would explain all of its torque.
_TERM_SPREAD = 1.0


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent normal distributions, deliberately wide.

    They matter for combinations that the motion doesn't excite, which would otherwise be
    undetermined, and are overruled by data everywhere else.

    Attributes
    ----------
    mean, std : (p,) ndarray
        In the parameters' own units.
    """

    mean: Array
    std: Array


def prior_from_cad(
    cad: ArmParameters,
    model: JointModel,
    regression: ReducedRegression,
    link_spread: float = LINK_SPREAD,
) -> Prior:
    """Return a weak prior about the CAD parameters.

    Parameters
    ----------
    cad : ArmParameters
    model : JointModel
    regression : ReducedRegression
        Of the same columns: gives the scale of friction from the size of the torques.
    link_spread : float
        Standard deviation of the inertial parameters over their natural size.
    """
    mean = cad.vector(model)
    norms, torque = regression.column_norms(), regression.torque_norms
    joints = []
    for index, (joint, term) in enumerate(model.joint_columns, start=10 * model.n):
        norm = norms[joint, index]
        share = _TERM_SPREAD * torque[joint] / norm if norm > 0.0 else 0.0
        least = 0.5 * mean[index] if term.kind is not TermKind.OFFSET else 0.0
        joints.append(max(share, least, 1e-6))
    return Prior(mean, np.concatenate([link_spread * cad.inertial_scale().ravel(), joints]))
