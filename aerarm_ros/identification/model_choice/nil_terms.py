"""Terms of the joints that the data have no use for."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.regression.model_fit import ModelFit, fit_model
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate

_FRICTION = (TermKind.VISCOUS, TermKind.COULOMB)


def without_nil_terms(
    fit: ModelFit, estimate: Estimate, bags: Sequence[SampleColumns], cad: ArmParameters
) -> tuple[ModelFit, list[str]]:
    """Fit again without the terms whose coefficient the estimate has at its bound 0.

    Such as rotor inertia where a torque sensor sits behind the gear, which it does not feel. As
    long as it is a column, solvers without bounds give it a value that no rotor has. Friction
    (2.6), which every joint has, leaves only if the data ask for clearly less than 0.

    Parameters
    ----------
    fit : ModelFit
    estimate : Estimate
        Of this fit, with standard deviations.
    bags : sequence of SampleColumns
        To identify from.
    cad : ArmParameters

    Returns
    -------
    ModelFit
        The same if there is nothing to leave out.
    list of str
        Columns left out.
    """
    model, start = fit.model, 10 * fit.model.n
    friction = np.array([term.kind in _FRICTION for _, term in model.joint_columns], dtype=bool)
    std = np.zeros(len(fit.theta)) if estimate.std is None else estimate.std
    nil = estimate.held_at_zero[start:] & (~friction | (fit.theta < -std)[start:])
    if not nil.any():
        return fit, []
    kept = [own for own, is_nil in zip(model.joint_columns, nil, strict=True) if not is_nil]
    terms = tuple(tuple(t for j, t in kept if j == joint) for joint in range(model.n))
    smaller = JointModel(model.joint_names, model.link_names, terms)
    bank = RegressionBank(bags, [term for _, term in kept], estimate.inertial.ravel())
    left_out = [name for name, is_nil in zip(model.columns[start:], nil, strict=True) if is_nil]
    return fit_model(bags, bank, smaller, cad, fit.noise), left_out
