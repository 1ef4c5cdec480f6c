"""The wrench on the drone, compared with the physics engine's force in the mount."""

import numpy as np
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import BaseReaction

GRAVITY = np.array([0.0, 0.0, -9.81])


def test_at_rest_the_drone_carries_the_weight(robot, postures) -> None:
    reaction = BaseReaction(robot)
    for q in postures:
        result = reaction.evaluate(q, np.zeros(4), np.zeros(4))
        weight = robot.inertial_parameters[:, 0].sum() * 9.81
        # The arm pulls the drone down.
        np.testing.assert_allclose(result.wrench[:3], [0.0, 0.0, -weight], atol=1e-9)
        np.testing.assert_allclose(result.wrench, result.static, atol=1e-9)
        np.testing.assert_allclose(result.dynamic, 0.0, atol=1e-9)


def test_agrees_with_the_force_in_the_mount_of_a_flying_arm(robot, make_flying_arm) -> None:
    # Mounted off the body's origin and turned, as under a drone.
    turn = Rotation.from_euler('xyz', [2.8, 0.2, 0.5])
    flying = make_flying_arm(position=[0.05, -0.02, -0.1], turn=turn.as_quat()[[3, 0, 1, 2]])
    # The engine's rotors react on no link, see BaseReaction.
    flying.model.dof_armature[:] = 0.0
    reaction = BaseReaction(robot)
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
        result = reaction.evaluate(*joints, base)
        # The engine's sensor tells the wrench of the drone on the arm.
        np.testing.assert_allclose(-result.wrench, flying.wrench_in_mount, atol=1e-9)


def test_static_part_is_gravity_alone(robot, postures) -> None:
    reaction = BaseReaction(robot)
    dq, ddq = np.random.default_rng(5).normal(size=(2, 4))
    for q in postures:
        moving = reaction.evaluate(q, dq, ddq)
        resting = reaction.evaluate(q, 0 * dq, 0 * ddq)
        np.testing.assert_allclose(moving.static, resting.wrench, atol=1e-9)
        np.testing.assert_allclose(moving.static + moving.dynamic, moving.wrench, atol=1e-12)
        assert np.linalg.norm(moving.dynamic) > 0.01


def test_the_drone_carries_the_payload_too(robot, postures) -> None:
    alone, carrying = BaseReaction(robot), BaseReaction(robot)
    payload = np.zeros(10)
    payload[0] = 0.2
    carrying.dynamics.carry(payload)
    for q in postures:
        empty, full = (r.evaluate(q, np.zeros(4), np.zeros(4)) for r in (alone, carrying))
        np.testing.assert_allclose(full.wrench[:3] - empty.wrench[:3], 0.2 * GRAVITY, atol=1e-9)
        np.testing.assert_allclose(full.mass - empty.mass, 0.2, atol=1e-12)
