"""The CAD model as a parameter vector."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.model.regressor import Regressor


def test_vector_is_the_regressors(robot: Robot, config: ArmConfig) -> None:
    cad = ArmParameters.stated(robot, config)
    model = JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR))
    expected = Regressor(robot, rotor_inertia=True).parameters(
        robot.inertial_parameters, robot.viscous, robot.coulomb, config.column('reflected_inertia')
    )
    assert np.array_equal(cad.vector(model), expected)


def test_terms_without_cad_value_are_zero(robot: Robot) -> None:
    cad = ArmParameters.stated(robot, None)
    terms = (ROTOR, JointTerm(TermKind.LOAD))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    assert not cad.vector(model)[40:].any()


def test_scale_grows_with_the_link(robot: Robot) -> None:
    cad = ArmParameters.stated(robot, None)
    scale = cad.inertial_scale()
    assert np.array_equal(scale[:, 0], cad.inertial[:, 0])
    assert np.allclose(scale[:, 1] ** 2, scale[:, 0] * scale[:, 4])
    assert np.all(scale >= np.abs(cad.inertial) * 0.99)


def test_urdf_and_configuration_of_different_arms(robot: Robot, config: ArmConfig) -> None:
    other = load_robot(robot.urdf_text.replace('"joint3"', '"elbow"'))
    with pytest.raises(IdentificationError, match='elbow of the URDF are not in the configuration'):
        ArmParameters.stated(other, config)
