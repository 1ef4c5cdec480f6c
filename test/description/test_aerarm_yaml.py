"""The packaged configuration: thesis tables, the frame's ceilings, a stable velocity loop."""

from itertools import product

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.dynamics import Dynamics


@pytest.fixture(scope='module')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='module')
def robot() -> Robot:
    return load_robot()


def test_motors_are_those_of_table_4_1(config: ArmConfig) -> None:
    table = {  # p, Kv, K_i, I_max, tau_max
        'MN4004': (12, 300.0, 0.027, 9.0, 0.243),
        'MN4006': (12, 380.0, 0.022, 16.0, 0.352),
        'MN5006': (14, 300.0, 0.027, 20.0, 0.54),
    }
    assert {joint.motor.name for joint in config.joints} == set(table)
    for motor in (joint.motor for joint in config.joints):
        pole_pairs, kv, torque_constant, current_max, torque_max = table[motor.name]
        assert (motor.pole_pairs, motor.kv, motor.current_max) == (pole_pairs, kv, current_max)
        assert motor.torque_constant == pytest.approx(torque_constant, rel=0.025)
        assert motor.torque_constant * motor.current_max == pytest.approx(torque_max, rel=0.025)


def test_friction_is_that_of_table_4_3_at_the_joint(config: ArmConfig) -> None:
    assert np.array_equal(config.column('gear.ratio'), [1 / 31, 1 / 27, 1 / 31, 1 / 27])
    motor_side = np.array([6.45e-6, 3.96e-6, 2.42e-6, 3.96e-6])
    assert np.allclose(config.column('viscous'), motor_side / config.column('gear.ratio') ** 2)


def test_limits_agree_with_the_urdf(config: ArmConfig, robot: Robot) -> None:
    assert config.joint_names == robot.joint_names
    for field in ('position_min', 'position_max', 'velocity_max', 'effort_max'):
        assert np.array_equal(config.column(field), getattr(robot, field)), field
    for field in ('viscous', 'coulomb'):
        assert np.allclose(config.column(field), getattr(robot, field)), field


def test_the_arm_can_hold_and_accelerate_itself(config: ArmConfig, robot: Robot) -> None:
    """`acceleration_max`, one joint at a time, against gravity in the worst postures."""
    dynamics = Dynamics(robot, DriveTrain(config).reflected_inertia)
    for q2, q3, q4 in product((0.0, np.pi), (0.0, np.pi / 2), (0.0, np.pi / 2, -np.pi / 2)):
        q = np.array([0.0, q2, q3, q4])
        for row in np.diag(config.column('acceleration_max')):
            for ddq in (row, -row):
                joint = int(np.argmax(np.abs(ddq)))
                torque = dynamics.inverse(q, np.zeros(4), ddq)[joint]
                assert abs(torque) < config.column('effort_max')[joint]


def test_the_velocity_loop_is_damped_in_every_posture(config: ArmConfig, robot: Robot) -> None:
    """Thesis (4.5) on the boards, behind their 100 Hz velocity filter, linearised.

    States: position error, velocity error, filtered velocity error.
    """
    drive = DriveTrain(config)
    dynamics = Dynamics(robot, drive.reflected_inertia)
    stiffness = np.diag(drive.motor_to_joint_gain(config.column('board_kp')))
    damping = np.diag(drive.motor_to_joint_gain(config.column('board_kd')))
    cutoff = 2.0 * np.pi * 100.0
    zero, one = np.zeros((4, 4)), np.eye(4)
    for q2, q3, q4 in product((-0.5, 0.0, 0.8, np.pi / 2), (0.0, 0.8, np.pi / 2), (0.0, 1.0, 2.09)):
        mobility = np.linalg.inv(dynamics.inertia_matrix(np.array([0.0, q2, q3, q4])))
        system = np.block(
            [
                [zero, one, zero],
                [-mobility @ stiffness, zero, -mobility @ damping],
                [zero, cutoff * one, -cutoff * one],
            ]
        )
        poles = np.linalg.eigvals(system)
        assert np.all(poles.real < -5.0)
        assert np.all(-poles.real / np.abs(poles) > 0.4)
        bandwidth = np.linalg.eigvals(mobility @ damping).real
        assert np.all(bandwidth < 0.5 * cutoff)
