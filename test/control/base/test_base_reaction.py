"""The wrench on the drone, compared with the physics engine's force in the mount."""

import numpy as np
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics

GRAVITY = np.array([0.0, 0.0, -9.81])


def test_at_rest_the_drone_carries_the_weight(robot, postures) -> None:
    dynamics = MovingBaseDynamics(robot)
    for q in postures:
        wrench, static = dynamics.reaction(q, np.zeros(4), np.zeros(4))
        weight = robot.inertial_parameters[:, 0].sum() * 9.81
        # The arm pulls the drone down.
        np.testing.assert_allclose(wrench[:3], [0.0, 0.0, -weight], atol=1e-9)
        np.testing.assert_allclose(wrench, static, atol=1e-9)


def test_agrees_with_the_force_in_the_mount_of_a_flying_arm(robot, make_flying_arm) -> None:
    # Mounted off the body's origin and turned, as under a drone.
    turn = Rotation.from_euler('xyz', [2.8, 0.2, 0.5])
    flying = make_flying_arm(position=[0.05, -0.02, -0.1], turn=turn.as_quat()[[3, 0, 1, 2]])
    # The engine's rotors react on no link, see `reaction`.
    flying.model.dof_armature[:] = 0.0
    dynamics = MovingBaseDynamics(robot)
    random = np.random.default_rng(4)
    for _ in range(20):
        attitude = Rotation.random(random_state=random)
        twist, acceleration = random.normal(scale=2.0, size=(2, 6))
        joints = random.normal(scale=2.0, size=(3, 4))
        flying.inverse(attitude.as_quat()[[3, 0, 1, 2]], twist, acceleration, joints)
        to_mount = (attitude * turn).inv()
        lever = np.array([0.05, -0.02, -0.1])
        rate, spin = twist[3:], acceleration[3:]
        at_mount = np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
        force = to_mount.apply(acceleration[:3] - GRAVITY) + turn.inv().apply(at_mount)
        base = BaseMotion(
            to_mount.apply(GRAVITY), force, turn.inv().apply(rate), turn.inv().apply(spin)
        )
        wrench, _ = dynamics.reaction(*joints, base)
        # The engine's sensor tells the wrench of the drone on the arm.
        np.testing.assert_allclose(-wrench, flying.wrench_in_mount, atol=1e-9)


def test_static_part_is_gravity_alone(robot, postures) -> None:
    dynamics = MovingBaseDynamics(robot)
    dq, ddq = np.random.default_rng(5).normal(size=(2, 4))
    for q in postures:
        moving, static = dynamics.reaction(q, dq, ddq)
        resting, _ = dynamics.reaction(q, 0 * dq, 0 * ddq)
        np.testing.assert_allclose(static, resting, atol=1e-9)
        assert np.linalg.norm(moving - static) > 0.01


def test_the_drone_carries_the_payload_too(robot, postures) -> None:
    alone, carrying = MovingBaseDynamics(robot), MovingBaseDynamics(robot)
    payload = np.zeros(10)
    payload[0] = 0.2
    carrying.carry(payload)
    for q in postures:
        empty, full = (r.reaction(q, np.zeros(4), np.zeros(4))[0] for r in (alone, carrying))
        np.testing.assert_allclose(full[:3] - empty[:3], 0.2 * GRAVITY, atol=1e-9)
