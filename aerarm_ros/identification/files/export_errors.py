"""Torque errors of exported files, because each format stores only a part of the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerarm_ros.identification.assessment import assess
from aerarm_ros.identification.files.identified_robot import equivalent_friction
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import ROTOR, THESIS_TERMS, JointModel, TermKind
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True)
class ExportError:
    """Torque error of the model that a typical program reads from an exported file.

    Attributes
    ----------
    contents : str
        Parts of the model that the program reads.
    filtered : tuple of float
        Filtered torque error (5.3) [%] on each identification bag, then on each validation bag.
    """

    file: str
    contents: str
    filtered: tuple[float, ...]


def export_errors(result: IdentificationResult) -> list[ExportError]:
    """Return the torque error of each file that an identification writes.

    Other programs support neither torque offsets nor friction other than (2.6). URDF and SDF
    files cannot store gravity, so they are evaluated with the stated gravity instead of the
    identified one.
    """
    estimate = result.recommended.estimate
    bags = [*result.identification, *result.validation]
    level = _under_stated_gravity(result, bags)
    friction = equivalent_friction(estimate, result.identification)
    rotors = estimate.joint_values(TermKind.ROTOR.value)
    none = np.zeros_like(rotors)
    with_rotors = _simple(estimate, *friction, rotors)
    without = _simple(estimate, *friction, none)
    found = (
        ('estimate.yaml', 'whole model (load_identified)', estimate, bags),
        ('identified.xml', 'MuJoCo: links, rotors, friction (2.6)', with_rotors, bags),
        ('identified.urdf', 'Pinocchio and others: links, friction (2.6)', without, level),
        ('identified.sdf', 'Drake: links, rotors, friction (2.6)', with_rotors, level),
        ('identified.sdf', 'Gazebo and others: links, friction (2.6)', without, level),
    )
    known: dict[tuple[int, int], tuple[float, ...]] = {}
    for _, _, model, columns in found:
        if (id(model), id(columns)) not in known:
            errors = tuple(bag.filtered for bag in assess(model, columns))
            known[id(model), id(columns)] = errors
    return [
        ExportError(file, contents, known[id(model), id(columns)])
        for file, contents, model, columns in found
    ]


def _under_stated_gravity(
    result: IdentificationResult, bags: Sequence[SampleColumns]
) -> Sequence[SampleColumns]:
    gravity = result.gravity
    if gravity is None or gravity.tilt == 0.0:
        return bags
    regressor = Regressor(result.robot.with_gravity(gravity.stated))
    return [SampleColumns(bag.samples, regressor) for bag in bags]


def _simple(estimate: Estimate, viscous: Array, coulomb: Array, rotors: Array) -> Estimate:
    """Return an estimate reduced to links, friction (2.6) and rotor inertia."""
    model = estimate.model
    terms = (*THESIS_TERMS, ROTOR)
    simple = JointModel.uniform(model.joint_names, model.link_names, terms)
    columns = dict(zip(terms, (viscous, coulomb, rotors), strict=True))
    joints = [columns[term][joint] for joint, term in simple.joint_columns]
    theta = np.concatenate([estimate.inertial.ravel(), joints])
    return replace(estimate, model=simple, theta=theta, std=None, determined=None)
