"""Estimates as YAML files that ROS nodes read with `--params-file`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import read_yaml, yaml_text
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import NOT_FRICTION, JointModel, JointTerm, TermKind
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations; importing the solvers takes 0.3 s
    from aerarm_ros.identification.identification_result import IdentificationResult
    from aerarm_ros.identification.payload import Payload

NO_FRICTION = (TermKind.OFFSET, *NOT_FRICTION)
"""Kinds of joint terms that are not friction."""


_HEADER = """\
# Dynamic parameters identified from recorded motion. SI units, joint side.
# inertial_parameters: for each link m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the
# frame of the link's joint. viscous and coulomb: friction model (2.6) of the thesis, fitted to the
# complete friction model in `friction`, including load-dependent friction.
# (identified.urdf lists load-dependent friction separately.)
# friction: the complete friction torque at the velocity dq is the sum of three groups of terms:
#   viscous dq + coulomb s(dq) + load |torque on the links| s(dq);
#   creep tanh(dq / creep_width) + offset + stribeck sgn(dq) exp(-(dq / stribeck_width)^2);
#   forward max(a(dq), 0) + backward min(a(dq), 0).
# The function s(dq) is tanh(dq / coulomb_width), or sgn(dq) if coulomb_width is 0. If
# coulomb_distance is not 0, friction builds up after a reversal: s is then the state z of
# dz = (sgn(dq) - z) |dq| dt / coulomb_distance, and sgn(dq) in steady motion. The function a(dq) is
# tanh(dq / asymmetry_width). The term creep is viscous friction that saturates at high velocity.
# coupled_joints, only if joints are coupled: for each coupling the joint, the joint that drives
# it, the kind, and the coefficient. Kind cv: torque per velocity of the driving joint. Kind ca:
# torque per acceleration of the driving joint.
# from_data: 1 if the recordings determine the parameter, 0 if it keeps its CAD value. If the
# recordings determine only a sum of parameters (base_parameters), the CAD values determine the
# single parameters.
# base_parameters: the sums of parameters on which the torque depends and which the recordings
# determine. Their standard deviations follow from the recordings alone, without the CAD values.
"""

_PAYLOAD_HEADER = """\
# Payload of the last link, identified from recorded motion. SI units, in the frame of that
# link's joint. inertial_parameters: parameters of all links of the arm, with the payload as part
# of the last link, in the order of estimate.yaml.
"""

# Friction terms to which each width parameter belongs.
WIDTHS = {
    'coulomb_width': (TermKind.COULOMB, TermKind.LOAD),
    'creep_width': (TermKind.CREEP,),
    'stribeck_width': (TermKind.STRIBECK,),
    'asymmetry_width': (TermKind.FORWARD, TermKind.BACKWARD),
}

# Parameter name of each kind of term.
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
    estimate : Estimate
        Estimate to write.
    viscous, coulomb : (n,) ndarray
        Viscous [Nms/rad] and Coulomb [Nm] friction of thesis (2.6) nearest to that of the
        estimate.
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
    if estimate.determined is not None:
        parameters['from_data'] = _per_kind(estimate, estimate.determined)
    if result.used_base.rank:
        parameters['base_parameters'] = {
            'expressions': result.used_base.expressions(),
            'values': _floats(result.used_base.values(estimate.theta)),
            'standard_deviations': _floats(result.base_deviations),
        }
    document = {'/**': {'ros__parameters': parameters}}
    return _HEADER + yaml_text(document)


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
    friction['coulomb_distance'] = [
        max((float(term.distance) for term in terms), default=0.0) for terms in estimate.model.terms
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
    """Return one value per parameter, grouped by kind of parameter as in estimate.yaml."""
    spread = Estimate(estimate.solver, estimate.model, values)
    kinds = {name: _floats(spread.joint_values(kind.value)) for kind, name in NAMES.items()}
    return {'inertial_parameters': _floats(spread.inertial), **kinds}


def _floats(values: npt.ArrayLike) -> list[float]:
    return [float(value) for value in np.ravel(values)]


def payload_yaml(estimate: Estimate, payload: Payload) -> str:
    """Return the text of payload.yaml: the payload, and the parameters of the arm with payload.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the arm without payload.
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
    return _PAYLOAD_HEADER + yaml_text(document)


def ros_parameters(path: Path) -> Mapping[str, Any]:
    """Read the ROS parameters of an estimate.

    Raises
    ------
    ConfigError
        If the file cannot be read.
    IdentificationError
        If the file is not an estimate.
    """
    document = read_yaml(path)
    with suppress(KeyError, TypeError, ValueError):
        parameters = dict(document['/**']['ros__parameters'])
        if isinstance(parameters['joint_names'], list):
            return parameters
    raise IdentificationError(
        f'{path} is not an estimate.yaml: pass the unchanged file of the identifier'
    )


def read_estimate(path: Path, robot: Robot) -> Estimate:
    """Read an estimate from a file that contains the text of `estimate_yaml`.

    Parameters
    ----------
    robot : Robot
        Robot with the same joints.

    Raises
    ------
    ConfigError
        If the file cannot be read.
    IdentificationError
        If the file is not an estimate, or belongs to another arm.
    """
    parameters, n = ros_parameters(path), robot.n
    names = tuple(parameters['joint_names'])
    if names != robot.joint_names:
        raise IdentificationError(
            f'{path} has {len(names)} joints ({", ".join(map(str, names))}), but the URDF has '
            f'{n} ({", ".join(robot.joint_names)}): pass the URDF of that arm, with its joints in '
            'the same order (--urdf)'
        )
    try:
        inertial = np.array(parameters['inertial_parameters'], dtype=float).reshape(10 * n)
        own = joint_terms(parameters, n)
        if coupled := parameters.get('coupled_joints'):
            columns = (coupled[key] for key in ('joints', 'drivers', 'kinds', 'values'))
            for joint, driver, kind, value in zip(*columns, strict=True):
                term = JointTerm(TermKind(kind), driver=names.index(driver))
                own[names.index(joint)][term] = float(value)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise IdentificationError(
            f'{path} is not an estimate.yaml of an arm with {n} joints ({_fault(error)}): '
            'pass the unchanged file of the identifier'
        ) from None
    _check_distances(path, names, own)
    model = JointModel(robot.joint_names, robot.link_names, tuple(map(tuple, own)))
    joints = [own[joint][term] for joint, term in model.joint_columns]
    theta = np.concatenate([inertial, joints])
    if not np.isfinite(theta).all():
        raise IdentificationError(
            f'{path} contains numbers that are not finite: identify the arm again'
        )
    return Estimate(str(parameters.get('solver', '')), model, theta)


def estimated_arm(path: Path, gravity: Array | None = None) -> tuple[tuple[str, ...], Array]:
    """Read the joint names and the gravity (3,) in the base frame [m/s^2] from an estimate.

    Parameters
    ----------
    gravity : (3,) ndarray, optional
        Gravity that is returned if the file contains none.

    Raises
    ------
    ConfigError
        If the file cannot be read.
    IdentificationError
        If the file is not an estimate, or its gravity is not three numbers.
    """
    parameters = ros_parameters(path)
    try:
        used = np.array(parameters.get('gravity_in_base', gravity), dtype=float).reshape(3)
    except (TypeError, ValueError):
        used = np.full(3, np.nan)
    if not np.isfinite(used).all():
        raise IdentificationError(
            f'gravity_in_base of {path} is not three numbers: pass the unchanged file of the '
            'identifier'
        )
    return tuple(map(str, parameters['joint_names'])), used


def joint_terms(parameters: Mapping[str, Any], n: int) -> list[dict[JointTerm, float]]:
    """Return the coefficients of each joint's torque terms; terms of coupled joints are omitted.

    An entry that an older file lacks is zero for all joints.

    Parameters
    ----------
    parameters : mapping
        ROS parameters of an estimate.
    n : int
        Number of joints.

    Raises
    ------
    KeyError, TypeError, AttributeError, ValueError
        If the mapping is not an estimate of n joints.
    """
    entries = {**parameters['friction'], 'rotor_inertia': parameters.get('rotor_inertia')}

    def numbers(name: str) -> Array:
        values = entries.get(name)
        return np.zeros(n) if values is None else np.array(values, dtype=float).reshape(n)

    columns = {kind: numbers(name) for kind, name in NAMES.items()}
    widths = {kind: numbers(name) for name, kinds in WIDTHS.items() for kind in kinds}
    distances = dict.fromkeys(WIDTHS['coulomb_width'], numbers('coulomb_distance'))
    none = np.zeros(n)
    return [
        {
            JointTerm(
                kind,
                float(widths.get(kind, none)[joint]),
                distance=float(distances.get(kind, none)[joint]),
            ): float(column[joint])
            for kind, column in columns.items()
            if column[joint] != 0.0
        }
        for joint in range(n)
    ]


def _check_distances(path: Path, names: Sequence[str], own: Sequence[Iterable[JointTerm]]) -> None:
    for name, terms in zip(names, own, strict=True):
        for term in terms:
            if not 0.0 <= term.distance < np.inf:
                raise IdentificationError(
                    f'coulomb_distance of {name} in {path} is {term.distance:g} rad: use a finite, '
                    'non-negative angle'
                )
            if term.distance and term.width:
                raise IdentificationError(
                    f'coulomb_distance and coulomb_width of {name} in {path} are both set: set one '
                    'of the two to 0'
                )


def _fault(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f'{error} is missing'
    if isinstance(error, ValueError):
        return 'a list has a wrong length, or contains something other than numbers'
    return 'the file lacks the keys of an estimate'
