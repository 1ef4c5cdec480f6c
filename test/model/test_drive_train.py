"""The drive train conserves power, and follows signs and offsets."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain, load_arm_config


def changed(config: ArmConfig, index: int, **fields: object) -> ArmConfig:
    """Return the configuration with some fields of one joint changed."""
    joints = list(config.joints)
    joints[index] = replace(joints[index], **fields)  # type: ignore[arg-type]
    return replace(config, joints=tuple(joints))


@pytest.fixture
def config() -> ArmConfig:
    """The arm's drive train with two reversed motors and two encoders not at zero."""
    config = load_arm_config()
    config = changed(config, 1, sign=-1, offset=0.4)
    return changed(config, 2, sign=-1, offset=-1.1)


@pytest.fixture
def drive(config: ArmConfig) -> DriveTrain:
    return DriveTrain(config)


def test_conversions_are_undone(drive: DriveTrain, rng: np.random.Generator) -> None:
    for x in (rng.normal(size=4), rng.normal(size=(7, 4))):
        there = drive.joint_to_motor_position(x)
        assert np.allclose(drive.motor_to_joint_position(there), x)
        assert np.allclose(drive.motor_to_joint_velocity(drive.joint_to_motor_velocity(x)), x)
        assert np.allclose(drive.current_to_effort(drive.effort_to_current(x)), x)
        assert np.allclose(drive.motor_to_joint_gain(drive.joint_to_motor_gain(x)), x)


def test_power_passes_the_gear(
    config: ArmConfig, drive: DriveTrain, rng: np.random.Generator
) -> None:
    """Thesis (4.6), (4.7) with efficiency 1: K_i i_q times motor speed is tau times dq."""
    dq, current = rng.normal(size=(2, 4))
    motor_torque = config.column('motor.torque_constant') * current
    motor_power = motor_torque * drive.joint_to_motor_velocity(dq)
    assert np.allclose(drive.current_to_effort(current) * dq, motor_power)


def test_the_rotor_keeps_its_kinetic_energy(config: ArmConfig, drive: DriveTrain) -> None:
    dq = np.array([0.5, -1.0, 2.0, 1.5])
    rotor = config.column('motor.rotor_inertia') * drive.joint_to_motor_velocity(dq) ** 2
    assert np.allclose(drive.reflected_inertia * dq**2, rotor)
    assert np.all((drive.reflected_inertia > 0.007) & (drive.reflected_inertia < 0.025))


def test_board_gains_make_a_restoring_torque_whatever_the_sign(
    config: ArmConfig, drive: DriveTrain
) -> None:
    """The board's law (4.4) at the motor equals the same law at the joint."""
    kp = config.column('board_kp')
    q, reference = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.2, 0.1, 0.4, 0.3])
    error = drive.joint_to_motor_position(reference) - drive.joint_to_motor_position(q)
    torque = drive.current_to_effort(kp * error)
    assert np.allclose(torque, drive.motor_to_joint_gain(kp) * (reference - q))
    assert np.all(torque * (reference - q) > 0.0)
