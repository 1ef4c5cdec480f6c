"""What makes an estimate physical."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.solvers.estimate import Estimate

OFFSET = JointTerm(TermKind.OFFSET)


@pytest.fixture
def model(robot: Robot) -> JointModel:
    return JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR, OFFSET))


def test_the_cad_column_of_table_a1_is_physical_the_others_are_not(
    model: JointModel, robot: Robot, table_a1: dict[str, np.ndarray]
) -> None:
    """thesis-notes: SLSQP fails the pseudo-inertia test, SA even (3.9)."""
    plain = JointModel.uniform(robot.joint_names, robot.link_names, THESIS_TERMS)
    physical = {k: Estimate(k, plain, v).physically_consistent for k, v in table_a1.items()}
    assert physical == {'CAD': True, 'SLSQP': False, 'SA': False}
    eigenvalue = Estimate('', plain, table_a1['CAD']).min_pseudo_inertia_eigenvalue
    assert eigenvalue == pytest.approx(1.6e-5, rel=0.05)


@pytest.mark.parametrize(('column', 'physical'), [('fv_joint2', False), ('fo_joint2', True)])
def test_negative_coefficients(
    model: JointModel, robot: Robot, column: str, physical: bool
) -> None:
    theta = ArmParameters.stated(robot, None).vector(model)
    theta[model.columns.index(column)] = -0.1
    estimate = Estimate('test', model, theta)
    assert estimate.physically_consistent == physical
    assert estimate.joint_values(column[:2])[1] == -0.1


def test_links_without_mass_are_not_physical(model: JointModel) -> None:
    assert not Estimate('test', model, np.zeros(len(model.columns))).physically_consistent
