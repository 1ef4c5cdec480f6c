"""What MuJoCo loads moves as the identified arm does."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.files.identified_robot import identified_mjcf, identified_urdf
from aerarm_ros.model.dynamics import Dynamics


def torque(model: mujoco.MjModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the torque of MuJoCo's links and rotors; friction and limits are passive there."""
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qacc = q, dq, ddq
    model.dof_frictionloss[:], model.dof_damping[:], model.jnt_limited[:] = 0.0, 0.0, 0
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


@pytest.mark.parametrize('file', [None, 'ur10_robot.urdf', 'panda.urdf'])
def test_mujoco_and_pinocchio_need_the_same_torque(
    file: str | None, example_urdf: Callable[[str], Path]
) -> None:
    locked = ['panda_finger_joint1', 'panda_finger_joint2'] if file == 'panda.urdf' else []
    robot = load_robot(None if file is None else example_urdf(file), locked=locked)
    robot = robot.with_gravity([0.3, -0.2, -9.8])
    random = np.random.default_rng(0)
    inertial = robot.inertial_parameters * random.uniform(0.9, 1.1, (robot.n, 1))
    viscous, coulomb, rotor = random.uniform(0.1, 0.5, (3, robot.n))
    text = identified_mjcf(robot, inertial, viscous, coulomb, rotor)
    model = mujoco.MjModel.from_xml_string(text)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    assert tuple(names) == robot.joint_names
    assert model.dof_damping == pytest.approx(viscous)
    assert model.dof_frictionloss == pytest.approx(coulomb)
    assert model.dof_armature == pytest.approx(rotor)
    dynamics = Dynamics(robot.with_inertial_parameters(inertial), rotor)
    for _ in range(20):
        q, dq, ddq = random.uniform(-1.5, 1.5, (3, robot.n))
        assert torque(model, q, dq, ddq) == pytest.approx(dynamics.inverse(q, dq, ddq), abs=1e-9)


def test_the_urdf_needs_the_same_torque(robot: Robot, tmp_path: Path) -> None:
    """Rotors and the gravity that was found have no place in it."""
    random = np.random.default_rng(1)
    inertial = robot.inertial_parameters * random.uniform(0.9, 1.1, (robot.n, 1))
    file = tmp_path / 'identified.urdf'
    file.write_text(identified_urdf(robot, inertial, np.full(4, 0.1), np.full(4, 0.2)).text)
    again = load_robot(file, gravity_in_base=robot.gravity_in_base)
    wanted = Dynamics(robot.with_inertial_parameters(inertial), np.zeros(4))
    for _ in range(20):
        q, dq, ddq = random.uniform(-1.5, 1.5, (3, robot.n))
        found = Dynamics(again, np.zeros(4)).inverse(q, dq, ddq)
        assert found == pytest.approx(wanted.inverse(q, dq, ddq), abs=1e-9)
    assert again.coulomb == pytest.approx(0.2)


def test_directions_and_limits_survive(robot: Robot) -> None:
    nothing = np.zeros(robot.n)
    text = identified_mjcf(robot, robot.inertial_parameters, nothing, nothing, nothing)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.opt.gravity == pytest.approx(robot.gravity_in_base)
    for joint in range(robot.n):
        limits = robot.position_min[joint], robot.position_max[joint]
        if np.isfinite(limits).all():
            assert model.jnt_range[joint] == pytest.approx(limits)
        else:
            assert not model.jnt_limited[joint]
