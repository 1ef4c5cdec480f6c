"""Identified friction in the joints' controllers."""

from dataclasses import replace

import numpy as np

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.joint_model import ROTOR, JointModel, JointTerm, TermKind
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.online.friction_trend import JointFriction
from aerarm_ros.online.replay import KnownArm


def test_friction_that_builds_up_is_compensated_as_in_steady_motion() -> None:
    robot = load_robot()
    dry = [JointTerm(kind) for kind in (TermKind.COULOMB, TermKind.LOAD)]
    torques = []
    for distance in (0.0, 0.01):
        own = [replace(term, distance=distance) for term in dry]
        terms = (JointTerm(TermKind.VISCOUS), *own, ROTOR)
        model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
        values = np.linspace(0.1, 0.3, len(model.joint_columns))
        theta = np.concatenate([robot.inertial_parameters.ravel(), values])
        friction = JointFriction(KnownArm.identified(robot, Estimate('sdp', model, theta)))
        dq, load = np.array([0.5, -0.2, 0.0, 0.1]), np.array([1.0, -2.0, 3.0, 0.5])
        torques.append(np.concatenate([friction.torque(dq, load), friction.dry(load)]))
    assert np.array_equal(*torques)
    assert np.abs(torques[0][[0, 1, 3]]).min() > 0.05
