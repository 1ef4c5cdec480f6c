"""Columns of joint models."""

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.model.regressor import Regressor


def test_columns_are_those_of_the_regressor(robot: Robot) -> None:
    """Whatever the order of the terms, (3.5): links, viscous, Coulomb, then rotors."""
    terms = (ROTOR, *reversed(THESIS_TERMS))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    assert model.columns == Regressor(robot, rotor_inertia=True).columns


def test_joints_may_differ(robot: Robot) -> None:
    load = JointTerm(TermKind.LOAD, 0.02)
    terms = (THESIS_TERMS, (*THESIS_TERMS, load), THESIS_TERMS, (ROTOR,))
    model = JointModel(robot.joint_names, robot.link_names, terms)
    assert model.columns[40:] == (
        *('fv_joint1', 'fv_joint2', 'fv_joint3'),
        *('fs_joint1', 'fs_joint2', 'fs_joint3'),
        *('Ja_joint4', 'fl_joint2'),
    )
    assert model.depends_on_load
    assert model.joint_columns[-1] == (1, load)
