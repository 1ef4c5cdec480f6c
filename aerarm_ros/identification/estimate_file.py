"""An estimate as YAML that ROS nodes read with `--params-file`."""

from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_term import TermKind

Array = npt.NDArray[np.float64]

_HEADER = """\
# Dynamic parameters identified from recorded motion. SI units, joint side.
# inertial_parameters: for each link m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about its
# joint's frame. viscous and coulomb: friction (2.6) nearest to the model in `friction`, which
# is complete: viscous dq + coulomb s(dq) + load |links' torque| s(dq) + creep
# tanh(dq / creep_width) + offset, with s(dq) = tanh(dq / coulomb_width), sgn(dq) for width 0.
"""

_NAMES = {
    TermKind.VISCOUS: 'viscous',
    TermKind.COULOMB: 'coulomb',
    TermKind.LOAD: 'load',
    TermKind.CREEP: 'creep',
    TermKind.OFFSET: 'offset',
    TermKind.ROTOR: 'rotor_inertia',
}


def estimate_yaml(
    result: IdentificationResult, estimate: Estimate, viscous: Array, coulomb: Array
) -> str:
    """Return the text of estimate.yaml.

    Parameters
    ----------
    result : IdentificationResult
    estimate : Estimate
        The one to write.
    viscous, coulomb : (n,) ndarray
        Friction (2.6) nearest to the estimate's [Nms/rad], [Nm].
    """
    model = estimate.model
    parameters: dict[str, Any] = {
        'solver': estimate.solver,
        'joint_names': list(model.joint_names),
        'link_names': list(model.link_names),
        'gravity_in_base': _floats(result.robot.gravity_in_base),
        'inertial_parameters': _floats(estimate.inertial),
        'viscous': _floats(viscous),
        'coulomb': _floats(coulomb),
        'rotor_inertia': _floats(estimate.joint_values(TermKind.ROTOR.value)),
        'friction': _friction(estimate),
    }
    if estimate.std is not None:
        parameters['standard_deviation'] = _deviations(estimate)
    document = {'/**': {'ros__parameters': parameters}}
    return _HEADER + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def _friction(estimate: Estimate) -> dict[str, list[float]]:
    friction = {
        name: _floats(estimate.joint_values(kind.value))
        for kind, name in _NAMES.items()
        if kind is not TermKind.ROTOR
    }
    for kind, name in ((TermKind.COULOMB, 'coulomb_width'), (TermKind.CREEP, 'creep_width')):
        friction[name] = [
            next((float(term.width) for term in terms if term.kind is kind), 0.0)
            for terms in estimate.model.terms
        ]
    return friction


def _deviations(estimate: Estimate) -> dict[str, list[float]]:
    assert estimate.std is not None
    spread = Estimate(estimate.solver, estimate.model, estimate.std)
    deviations = {'inertial_parameters': _floats(spread.inertial)}
    for kind, name in _NAMES.items():
        deviations[name] = _floats(spread.joint_values(kind.value))
    return deviations


def _floats(values: npt.ArrayLike) -> list[float]:
    return [float(value) for value in np.ravel(values)]
