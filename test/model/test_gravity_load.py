import numpy as np
import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import GRAVITY, Dynamics, largest_gravity_load


def test_no_direction_of_gravity_causes_a_larger_torque() -> None:
    robot = load_robot()
    largest = largest_gravity_load(robot)
    random = np.random.default_rng(1)
    for direction in random.normal(size=(50, 3)):
        gravity = GRAVITY * direction / np.linalg.norm(direction)
        dynamics = Dynamics(load_robot(gravity_in_base=gravity))
        for q in random.uniform(robot.position_min, robot.position_max, (20, robot.n)):
            assert np.all(np.abs(dynamics.gravity(q)) < 1.02 * largest)


def test_is_the_stretched_arm_about_its_first_two_joints() -> None:
    robot = load_robot()
    stretched = Dynamics(robot).gravity(np.zeros(robot.n))
    # A base on its side asks as much of joint 1 as a level one of joint 2.
    assert largest_gravity_load(robot)[:2] == pytest.approx(abs(stretched[1]), rel=0.02)
