"""The moving-base model, compared with the fixed-base model and the physics engine."""

import numpy as np
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics

GRAVITY = np.array([0.0, 0.0, -9.81])


def test_agrees_with_the_fixed_base_at_rest(dynamics, postures) -> None:
    random = np.random.default_rng(0)
    for q in postures:
        dq, ddq = random.normal(size=(2, 4))
        fixed = dynamics.fixed
        np.testing.assert_allclose(
            dynamics.inverse(q, dq, ddq), fixed.inverse(q, dq, ddq), atol=1e-12
        )
        np.testing.assert_allclose(dynamics.gravity(q), fixed.gravity(q), atol=1e-12)
        np.testing.assert_allclose(dynamics.bias(q, dq), fixed.bias(q, dq), atol=1e-12)


def test_torques_match_the_physics_engine_on_a_moving_base(dynamics, make_flying_arm) -> None:
    flying = make_flying_arm()
    random = np.random.default_rng(1)
    for _ in range(20):
        attitude = Rotation.random(random_state=random)
        twist, acceleration = random.normal(scale=3.0, size=(2, 6))
        joints = random.normal(scale=2.0, size=(3, 4))
        engine = flying.inverse(attitude, twist, acceleration, joints)
        to_base = attitude.inv()
        base = BaseMotion(
            to_base.apply(GRAVITY),
            to_base.apply(acceleration[:3] - GRAVITY),
            twist[3:],
            acceleration[3:],
        )
        np.testing.assert_allclose(dynamics.inverse(*joints, base), engine, atol=1e-9)


def samples(seed: int) -> list:
    """Return attitude, twist and acceleration (6,), q, dq, ddq (3, 4), ten times."""
    random = np.random.default_rng(seed)
    return [
        (
            Rotation.random(random_state=random),
            *random.normal(scale=3.0, size=(2, 6)),
            random.normal(scale=2.0, size=(3, 4)),
        )
        for _ in range(10)
    ]


def test_torques_match_the_physics_engine_on_a_base_that_answers(carried, make_flying_arm) -> None:
    """The engine computes the wrench that moves the base; the model receives only the wrench."""
    flying = make_flying_arm()
    for attitude, twist, acceleration, joints in samples(4):
        engine = flying.inverse(attitude, twist, acceleration, joints)
        wrench = np.array(flying.data.qfrc_inverse[:6])
        wrench[:3] = attitude.inv().apply(wrench[:3])
        base = BaseMotion(np.zeros(3), np.zeros(3), twist[3:], np.zeros(3))
        free = FreeBaseMotion(base, wrench, np.ones(6))
        q, dq, ddq = joints
        np.testing.assert_allclose(carried.inverse(q, dq, ddq, free), engine, atol=1e-9)
        bias = carried.bias(q, dq, free)
        np.testing.assert_allclose(bias + carried.inertia_matrix(q, free) @ ddq, engine, atol=1e-9)


def test_with_weight_zero_a_base_moves_as_prescribed(carried) -> None:
    for _, twist, acceleration, (q, dq, ddq) in samples(5):
        base = BaseMotion(np.zeros(3), acceleration[:3], twist[3:], acceleration[3:])
        free = FreeBaseMotion(base, np.ones(6), np.zeros(6))
        for ours, theirs in (
            (carried.inverse(q, dq, ddq, free), carried.inverse(q, dq, ddq, base)),
            (carried.gravity(q, free), carried.gravity(q, base)),
            (carried.inertia_matrix(q, free), carried.fixed.inertia_matrix(q)),
        ):
            np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_with_any_weight_of_the_response_joints_have_inertia(carried) -> None:
    """The weight of the response is up to 1.3, for a drone modelled as too heavy."""
    random = np.random.default_rng(8)
    still = BaseMotion.still(GRAVITY)
    for share in [np.full(6, 1.3), *random.uniform(0.0, 1.3, (20, 6))]:
        base = FreeBaseMotion(still, np.zeros(6), share)
        matrix = carried.inertia_matrix(random.uniform(-2.0, 2.0, 4), base)
        assert np.linalg.eigvalsh(matrix + matrix.T)[0] > 0.0


def test_feedback_acts_as_on_a_fixed_base(carried) -> None:
    for _, twist, acceleration, (q, dq, ddq) in samples(6):
        base = BaseMotion(np.zeros(3), acceleration[:3], twist[3:], acceleration[3:])
        free = FreeBaseMotion(base, np.arange(6.0), np.full(6, 0.8))
        planned = 0.5 * ddq
        difference = carried.inverse(q, dq, ddq, free, planned)
        difference = difference - carried.inverse(q, dq, planned, free)
        np.testing.assert_allclose(
            difference, carried.fixed.inertia_matrix(q) @ (ddq - planned), atol=1e-9
        )


def test_gravity_torques_hold_the_arm_on_a_responding_base(carried) -> None:
    zero = np.zeros(4)
    for _, twist, _, (q, _, ddq) in samples(7):
        base = BaseMotion(np.zeros(3), np.zeros(3), twist[3:], np.zeros(3))
        free = FreeBaseMotion(base, np.arange(6.0), np.ones(6))
        np.testing.assert_allclose(carried.gravity(q, free), carried.bias(q, zero, free))
        # The base's answer to a joint acceleration that another torque brings about.
        moved = carried.inverse(q, zero, ddq, free) - carried.fixed.inertia_matrix(q) @ ddq
        np.testing.assert_allclose(carried.gravity(q, free, ddq), moved, atol=1e-9)


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
        flying.inverse(attitude, twist, acceleration, joints)
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
