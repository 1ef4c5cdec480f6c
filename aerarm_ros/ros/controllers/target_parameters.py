"""Parameters of tool targets, and the follower made from them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from aerarm_ros.control.references.target_follower import TargetFollower
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.parameters.parameter import Parameter

TARGET_PARAMETERS = (
    Parameter('frame', 'tool0', 'link that is moved'),
    Parameter('target_frequency', 15.0, 'stiffness of the path to a target', 'rad/s', 0.1, 100.0),
    Parameter('tool_velocity_max', 0.8, 'largest speed of the reference', 'm/s', 1e-3, 10.0),
    Parameter('tool_acceleration_max', 4.0, 'and its acceleration', 'm/s^2', 1e-2, 100.0),
)


def make_target_follower(values: SimpleNamespace, arm: ControlledArm) -> TargetFollower:
    """Return the reference generator; targets beyond the stretched arm are out of reach."""
    return TargetFollower(
        Kinematics(arm.robot, values.frame),
        values.target_frequency,
        values.tool_velocity_max,
        values.tool_acceleration_max,
        _stretched_length(arm, values.frame),
    )


def _stretched_length(arm: ControlledArm, frame: str) -> float:
    """Return the sum of the distances from joint to joint, and on to the frame [m]."""
    model, frame = arm.robot.model, arm.robot.full_name(frame)
    offsets = [model.jointPlacements[index].translation for index in range(1, model.njoints)]
    offsets.append(model.frames[model.getFrameId(frame)].placement.translation)
    return float(sum(np.linalg.norm(offset) for offset in offsets))
