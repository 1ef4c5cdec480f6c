"""The joints' planned motion for the tool, as published for the drone."""

import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import TaskReference
from aerarm_ros.world.base_pose import BasePose
from aerarm_ros.world.world_reference import planned_joints

Q = np.array([0.2, 1.2, -0.3, 1.4])
TIMES = 5.0 + np.linspace(0.0, 0.1, 6)
POSE = BasePose(np.array([1.0, 0.0, 2.0]), np.zeros(3), np.eye(3), np.zeros(3))
INVERSE = DampedInverse(1e-3, 5e-4)


def swing(time: float) -> TaskReference:
    w = 6.0
    along = np.array([0.05, -0.02, 0.03])
    return TaskReference(
        along * np.sin(w * time), w * along * np.cos(w * time), -(w**2) * along * np.sin(w * time)
    )


def test_between_the_points_the_tool_moves_as_planned() -> None:
    kinematics = Kinematics(load_robot())
    planned = [swing(time) for time in TIMES.tolist()]
    motion = planned_joints(kinematics, INVERSE, Q, POSE, planned, TIMES)
    path = PolynomialPath.quintic(TIMES - TIMES[0], *motion)
    for time in np.linspace(0.0, 0.099, 30):
        q, dq, ddq = path.evaluate(float(time))
        wanted = swing(5.0 + time)
        jacobian = kinematics.position_jacobian(q)
        assert jacobian @ dq == pytest.approx(wanted.dp, abs=5e-3)
        moved: npt.NDArray[np.float64] = jacobian @ ddq + kinematics.acceleration_bias(q, dq)[:3]
        assert moved == pytest.approx(wanted.ddp, abs=0.15)
