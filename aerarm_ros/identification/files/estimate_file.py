"""An estimate as YAML that ROS nodes read with `--params-file`."""

from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.files.friction_torque import friction_deviations
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.payload.payload import Payload
from aerarm_ros.identification.solvers.estimate import Estimate

Array = npt.NDArray[np.float64]

_HEADER = """\
# Dynamic parameters identified from recorded motion. SI units, joint side.
# inertial_parameters: for each link m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about its
# joint's frame. viscous and coulomb: friction (2.6) nearest to the model in `friction`, load
# included (identified.urdf has what is beside the load, and its share). That model is complete:
# viscous dq + coulomb s(dq) + load |links' torque| s(dq) + creep
# tanh(dq / creep_width) + offset + stribeck sgn(dq) exp(-(dq / stribeck_width)^2) + forward
# max(a(dq), 0) + backward min(a(dq), 0), with s(dq) = tanh(dq / coulomb_width), sgn(dq) for
# width 0, and a(dq) = tanh(dq / asymmetry_width).
# coupled_joints, where given: for each column its joint, the joint that drives it, cv (torque per
# velocity of the driver) or ca (per acceleration), and its coefficient.
# from_data: share of each value that comes from data (1) rather than from CAD (0). A parameter that
# stands in one of the sums below is shared out by CAD, however much the data say of the sum.
# friction_deviations: standard deviations of friction torques (offsets are no part of them), joint
# by joint at rising speeds, at the usual torque on its links (loads).
# base_parameters: the sums that the torque depends on, which the data determine, with their
# standard deviations by the data alone.
"""

_PAYLOAD_HEADER = """\
# What the last link carries, identified from recorded motion. SI units, in the frame of that
# link's joint. inertial_parameters: of the whole arm with the payload, as in estimate.yaml.
"""

# Which friction terms the width of each name is of.
WIDTHS = {
    'coulomb_width': (TermKind.COULOMB, TermKind.LOAD),
    'creep_width': (TermKind.CREEP,),
    'stribeck_width': (TermKind.STRIBECK,),
    'asymmetry_width': (TermKind.FORWARD, TermKind.BACKWARD),
}

# Name of each kind of term.
NAMES = {
    TermKind.VISCOUS: 'viscous',
    TermKind.COULOMB: 'coulomb',
    TermKind.LOAD: 'load',
    TermKind.CREEP: 'creep',
    TermKind.OFFSET: 'offset',
    TermKind.STRIBECK: 'stribeck',
    TermKind.FORWARD: 'forward',
    TermKind.BACKWARD: 'backward',
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
    coupled = _coupled(estimate)
    if coupled['values']:
        parameters['coupled_joints'] = coupled
    if estimate.std is not None:
        parameters['standard_deviation'] = _per_kind(estimate, estimate.std)
        deviations = asdict(friction_deviations(result))
        parameters['friction_deviations'] = {key: _floats(v) for key, v in deviations.items()}
    if estimate.determined is not None:
        parameters['from_data'] = _per_kind(estimate, estimate.determined)
    if result.used_base.rank:
        parameters['base_parameters'] = {
            'expressions': result.used_base.expressions(),
            'values': _floats(result.used_base.values(estimate.theta)),
            'standard_deviations': _floats(result.base_deviations),
        }
    document = {'/**': {'ros__parameters': parameters}}
    return _HEADER + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def _friction(estimate: Estimate) -> dict[str, list[float]]:
    friction = {
        name: _floats(estimate.joint_values(kind.value))
        for kind, name in NAMES.items()
        if kind is not TermKind.ROTOR
    }
    for name, kinds in WIDTHS.items():
        friction[name] = [
            next((float(term.width) for term in terms if term.kind in kinds), 0.0)
            for terms in estimate.model.terms
        ]
    return friction


def _coupled(estimate: Estimate) -> dict[str, list[Any]]:
    model, start = estimate.model, 10 * estimate.model.n
    names = model.joint_names
    entries: dict[str, list[Any]] = {
        key: [] for key in ('joints', 'drivers', 'kinds', 'values', 'standard_deviations')
    }
    for index, (joint, term) in enumerate(model.joint_columns, start):
        if term.driver is not None:
            std = 0.0 if estimate.std is None else float(estimate.std[index])
            row = (names[joint], names[term.driver], term.symbol, float(estimate.theta[index]), std)
            for column, value in zip(entries.values(), row, strict=True):
                column.append(value)
    return entries


def _per_kind(estimate: Estimate, values: Array) -> dict[str, list[float]]:
    """Return something known of every parameter in the shape of the parameters."""
    spread = Estimate(estimate.solver, estimate.model, values)
    kinds = {name: _floats(spread.joint_values(kind.value)) for kind, name in NAMES.items()}
    return {'inertial_parameters': _floats(spread.inertial), **kinds}


def _floats(values: npt.ArrayLike) -> list[float]:
    return [float(value) for value in np.ravel(values)]


def payload_yaml(estimate: Estimate, payload: Payload) -> str:
    """Return the text of payload.yaml: the payload, and the arm with it.

    Parameters
    ----------
    estimate : Estimate
        Of the arm alone.
    payload : Payload
    """
    together = np.array(estimate.inertial)
    together[-1] += payload.inertial
    parameters: dict[str, Any] = {
        'link_names': list(estimate.model.link_names),
        'inertial_parameters': _floats(together),
        'payload': {
            'link': payload.link,
            'mass': payload.mass,
            'mass_standard_deviation': float(payload.std[0]),
            'centre': _floats(payload.centre),
            'centre_standard_deviation': _floats(payload.centre_std),
            'inertial_parameters': _floats(payload.inertial),
            'standard_deviation': _floats(payload.std),
        },
    }
    document = {'/**': {'ros__parameters': parameters}}
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
    return _PAYLOAD_HEADER + text
