"""Torque of a motion compared with statics and energy."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import EffortModel
from aerarm_ros.excitation.trajectory import FourierTrajectory


def test_holding_the_arm_level_takes_its_weight_times_its_lever(
    robot: Robot, setup: ExcitationSetup
) -> None:
    rest = np.zeros((1, 4))
    effort = setup.effort_model.effort(rest, rest, rest)[0]
    pi = robot.inertial_parameters
    # First moments about joint 2 of links 2, 3 and 4, stretched along the base's x axis.
    moment = pi[1, 1] + (pi[2, 3] + 0.325 * pi[2, 0]) + (pi[3, 1] + 0.65 * pi[3, 0])
    assert effort[1] == pytest.approx(9.81 * moment, rel=1e-6)


def test_a_period_only_dissipates(
    robot: Robot, setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    time = np.arange(0.0, trajectory.period, 1e-3)
    reference = trajectory.evaluate(time)
    effort = setup.effort_model.effort(*reference)
    work = (effort * reference.dq).sum() * 1e-3
    friction = (robot.viscous * reference.dq**2 + robot.coulomb * np.abs(reference.dq)).sum() * 1e-3
    assert work == pytest.approx(friction, rel=1e-3)


def test_a_loaded_gear_needs_a_fraction_of_its_load_in_addition(robot: Robot) -> None:
    q, slow = np.zeros((2, 4)), np.array([1e-3, -1e-3])[:, np.newaxis] * np.ones(4)
    plain = EffortModel(robot).effort(q, slow, q)
    more = EffortModel(robot, load_friction=[0.0, 0.04, 0.0, 0.0]).effort(q, slow, q) - plain
    weight = EffortModel(robot).effort(q, q, q)[0, 1]
    np.testing.assert_allclose(more[:, 1], [0.04 * weight, -0.04 * weight], rtol=1e-3)
    assert (more[:, [0, 2, 3]] == 0.0).all()


def test_the_torque_of_the_rotors_does_not_load_the_gears(robot: Robot) -> None:
    q, dq, ddq = np.full((3, 1, 4), 0.3)
    light, heavy = (
        EffortModel(robot, rotors, load_friction=0.1).effort(q, dq, ddq)
        for rotors in (np.zeros(4), np.full(4, 2.0))
    )
    np.testing.assert_allclose(heavy - light, 2.0 * ddq)


def test_current_follows_the_drive_train(
    robot: Robot, arm: ArmConfig, setup: ExcitationSetup
) -> None:
    full = setup.effort_model.current(arm.column('effort_max'))
    np.testing.assert_allclose(full, arm.column('motor.current_max'), rtol=0.01)
    assert (EffortModel(robot).current(np.ones(4)) == 0.0).all()
