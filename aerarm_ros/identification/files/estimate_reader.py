"""An estimate read back from its YAML file, to be used as a fixed model of the arm."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.files.estimate_file import NAMES, WIDTHS
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import JointTerm, TermKind
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.solvers.estimate import Estimate

Array = npt.NDArray[np.float64]


def read_estimate(path: Path, robot: Robot) -> Estimate:
    """Return the estimate that `estimate_yaml` wrote.

    Parameters
    ----------
    path : Path
    robot : Robot
        Must have the same joints.

    Raises
    ------
    ConfigError
        If the file can't be read.
    IdentificationError
        If it is no estimate, or of another arm.
    """
    document = read_yaml(path)
    try:
        parameters = document['/**']['ros__parameters']
        names = tuple(parameters['joint_names'])
        _check_joints(path, names, robot.joint_names)
        inertial = np.array(parameters['inertial_parameters'], dtype=float).reshape(robot.n, 10)
        own = joint_terms(parameters, robot.n)
        coupled = _coupled(parameters.get('coupled_joints'), names)
    except IdentificationError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise IdentificationError(
            f'{path}: is no estimate.yaml of an arm with {robot.n} joints: {_fault(error)}: give '
            'the file as the identifier has written it'
        ) from None
    terms = [
        (*values, *(term for owner, term in coupled if owner == joint))
        for joint, values in enumerate(own)
    ]
    model = JointModel(robot.joint_names, robot.link_names, tuple(terms))
    joints = [
        own[joint][term] if term.driver is None else coupled[joint, term]
        for joint, term in model.joint_columns
    ]
    theta = np.concatenate([inertial.ravel(), joints])
    if not np.isfinite(theta).all():
        raise IdentificationError(f'{path}: holds numbers that are not finite')
    return Estimate(str(parameters.get('solver', '')), model, theta)


def joint_terms(parameters: Mapping[str, Any], n: int) -> list[dict[JointTerm, float]]:
    """Return each joint's terms and their coefficients, without couplings.

    Parameters
    ----------
    parameters : mapping
        ROS parameters of an estimate.
    n : int
        Number of joints.

    Raises
    ------
    KeyError, TypeError, AttributeError, ValueError
        If it is no estimate of so many joints.
    """
    friction = parameters['friction']
    values = {kind: _column(friction, parameters, kind, n) for kind in NAMES}
    widths = {name: _numbers(friction.get(name), n) for name in WIDTHS}
    return [
        {
            JointTerm(kind, _width(widths, kind, joint)): float(column[joint])
            for kind, column in values.items()
            if column[joint] != 0.0
        }
        for joint in range(n)
    ]


def read_gravity(path: Path, robot: Robot) -> Array:
    """Return (3,) gravity in the base frame as the identifier found it [m/s^2].

    Parameters
    ----------
    path : Path
        An estimate that `read_estimate` has accepted.
    robot : Robot
        Whose gravity it is if the file has none.

    Raises
    ------
    IdentificationError
        If it is not three numbers.
    """
    given = read_yaml(path)['/**']['ros__parameters'].get('gravity_in_base')
    if given is None:
        return robot.gravity_in_base
    try:
        gravity = np.array(given, dtype=float).reshape(3)
    except (TypeError, ValueError):
        gravity = np.full(3, np.nan)
    if not np.isfinite(gravity).all():
        raise IdentificationError(
            f'{path}: gravity_in_base is not three numbers: give the file as the identifier has '
            'written it'
        )
    return gravity


def _check_joints(path: Path, names: tuple[str, ...], wanted: tuple[str, ...]) -> None:
    if names != wanted:
        raise IdentificationError(
            f'{path}: is of {len(names)} joints {", ".join(map(str, names))}, the URDF has '
            f'{len(wanted)}: {", ".join(wanted)}: give the URDF of that arm (--urdf)'
        )


def _fault(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f'{error} is missing'
    if isinstance(error, ValueError):
        return 'a list has not the right length, or holds something else than numbers'
    return 'its keys are not those of an estimate'


def _column(
    friction: Mapping[str, Any], parameters: Mapping[str, Any], kind: TermKind, n: int
) -> Array:
    source = parameters if kind is TermKind.ROTOR else friction
    return _numbers(source.get(NAMES[kind]), n)


def _coupled(
    entries: Mapping[str, Any] | None, names: tuple[str, ...]
) -> dict[tuple[int, JointTerm], float]:
    """Return the coefficient of each coupled joint's column."""
    if entries is None:
        return {}
    columns = [entries[key] for key in ('joints', 'drivers', 'kinds', 'values')]
    return {
        (names.index(joint), JointTerm(TermKind(kind), driver=names.index(driver))): float(value)
        for joint, driver, kind, value in zip(*columns, strict=True)
    }


def _numbers(values: Any, n: int) -> Array:
    """Return (n,) numbers, zeros for what an older file doesn't have."""
    return np.zeros(n) if values is None else np.array(values, dtype=float).reshape(n)


def _width(widths: Mapping[str, Array], kind: TermKind, joint: int) -> float:
    owner = next((name for name, kinds in WIDTHS.items() if kind in kinds), None)
    return 0.0 if owner is None else float(widths[owner][joint])
