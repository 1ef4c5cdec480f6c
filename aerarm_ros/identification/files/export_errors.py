"""How well each exported file predicts torque: formats differ in what they have a place for."""

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
    """Torque errors of one written file, as a typical reader uses it.

    Attributes
    ----------
    file : str
    contents : str
        What the reader gets of the model.
    filtered : tuple of float
        Torque error (5.3) on each bag of identification, then of validation [%].
    """

    file: str
    contents: str
    filtered: tuple[float, ...]


def export_errors(result: IdentificationResult) -> list[ExportError]:
    """Return the torque error of each file that an identification writes.

    Readers know neither offsets nor friction of other forms than (2.6). URDF and SDF have no place
    for gravity, so that they are judged under the stated one.
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
    return [
        ExportError(file, contents, tuple(bag.filtered for bag in assess(model, columns)))
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
    """Return links and the joints' (n,) coefficients of thesis (2.6), with rotors."""
    model = estimate.model
    terms = (*THESIS_TERMS, ROTOR)
    simple = JointModel.uniform(model.joint_names, model.link_names, terms)
    columns = dict(zip(terms, (viscous, coulomb, rotors), strict=True))
    joints = [columns[term][joint] for joint, term in simple.joint_columns]
    theta = np.concatenate([estimate.inertial.ravel(), joints])
    return replace(estimate, model=simple, theta=theta, std=None, determined=None)
