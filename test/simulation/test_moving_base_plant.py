"""The moving base against the fixed one, and against the moving-base model."""

import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters
from aerarm_ros.simulation.base_profile import BaseProfile
from aerarm_ros.simulation.flying_plant import MovingBasePlant

START = np.array([0.3, 1.0, -0.4, 0.6])


@pytest.fixture
def parameters() -> PlantParameters:
    return PlantParameters.nominal(load_arm_config(), load_robot()).perturbed(3)


def test_on_a_still_base_it_is_the_fixed_plant(parameters) -> None:
    robot = load_robot()
    fixed = ArmPlant(robot, parameters, START)
    moving = MovingBasePlant(robot, parameters, START, BaseProfile())
    for plant in (fixed, moving):
        plant.apply_effort([0.3, 2.0, 0.2, 0.3])
        plant.advance(0.2)
    np.testing.assert_allclose(moving.position, fixed.position, atol=1e-4)
    np.testing.assert_allclose(moving.velocity, fixed.velocity, atol=1e-3)


def test_acceleration_agrees_with_the_moving_base_model(parameters) -> None:
    robot = load_robot()
    axis = np.array([0.6, 0.64, 0.48])
    profile = BaseProfile(axis, 0.3, 0.5, np.array([0.3, -0.2, 0.4]), 0.8, 1.1, ramp=0.5)
    free = parameters.without_friction()
    plant = MovingBasePlant(robot, free, START, profile)
    model = MovingBaseDynamics(
        robot.with_inertial_parameters(free.inertial_parameters), free.rotor_inertia
    )
    plant.start()
    effort = np.array([0.2, 2.5, 0.1, 0.2])
    plant.apply_effort(effort)
    for _ in range(200):
        q, dq = plant.position, plant.velocity
        _, rate, force = plant.imu
        base = BaseMotion(np.zeros(3), force, rate, plant.base.angular_acceleration)
        plant.step()
        expected = model.inverse(q, dq, plant.acceleration, base)
        np.testing.assert_allclose(effort, expected, atol=2e-4)


def test_the_profile_s_derivatives_belong_to_it() -> None:
    profile = BaseProfile(np.array([0.0, 1.0, 0.0]), 0.2, 0.5, np.array([0.1, 0.2, 0.3]), ramp=1.0)
    step = 1e-5
    for time in (0.3, 0.9, 2.7):
        before, here, after = (profile.evaluate(time + s) for s in (-step, 0.0, step))
        for value, rate in (
            ('position', 'velocity'),
            ('velocity', 'acceleration'),
            ('angular_velocity', 'angular_acceleration'),
        ):
            slope = (getattr(after, value) - getattr(before, value)) / (2 * step)
            np.testing.assert_allclose(slope, getattr(here, rate), atol=1e-6)
        turn = 2.0 * (after.quaternion - before.quaternion) / (2 * step)
        assert np.linalg.norm(turn) == pytest.approx(
            np.linalg.norm(here.angular_velocity), rel=1e-6
        )
