"""The control law of the tool in the world, compared with the mass matrix and differences."""

import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.world.base_pose import BasePose, _turned
from aerarm_ros.world.world_law import WorldGains, WorldLaw, WorldReference

Array = npt.NDArray[np.float64]

Q, DQ = np.array([0.3, 1.1, -0.4, 1.2]), np.array([0.3, -0.5, 0.4, 0.6])
RATE, WRENCH = np.array([0.4, -0.7, 0.5]), np.array([1.0, -2.0, -30.0, 0.5, -0.4, 0.3])
GRAVITY = np.array([1.0, -0.5, 9.7])
CYCLE = 1e-3


def law_of(carried: MovingBaseDynamics, limits: JointLimits, **gains: float) -> WorldLaw:
    law = WorldLaw(
        carried,
        Kinematics(carried.robot),
        limits,
        None,
        WorldGains(**gains),
        DampedInverse(1e-3, 5e-4),
    )
    law.acceleration_max = np.full(4, 1e6)
    law.take_over(Q)
    return law


@pytest.fixture
def pose() -> BasePose:
    turn = _turned(np.array([0.3, -0.2, 0.9]))
    return BasePose(np.array([1.0, 2.0, 3.0]), np.array([0.2, -0.1, 0.3]), turn, RATE)


@pytest.fixture
def free() -> FreeBaseMotion:
    still = BaseMotion(GRAVITY, np.zeros(3), RATE, np.zeros(3))
    return FreeBaseMotion(still, WRENCH, np.ones(6))


def accelerations(carried: MovingBaseDynamics, tau: Array) -> Array:
    """Return the base's specific force and the joints' accelerations (6 + n,) under torques."""
    whole = carried.whole
    bias = whole.forces(Q, DQ, np.zeros(4), RATE)
    return np.asarray(
        np.linalg.solve(whole.inertia_matrix(Q), np.concatenate([WRENCH, tau]) - bias)
    )


def tool_acceleration(kinematics: Kinematics, base: Array, ddq: Array) -> Array:
    """Return the tool's acceleration in base axes (3,), velocities by finite differences."""
    h = 1e-5
    spin, force = base[3:], base[:3]

    def place(time: float) -> Array:
        # About now the base's origin moves by its acceleration alone, and turns by rate and spin.
        q = Q + time * DQ + 0.5 * time**2 * ddq
        turn = _turned(time * RATE + 0.5 * time**2 * spin)
        moved = 0.5 * time**2 * (force + GRAVITY)
        return np.asarray(moved + turn @ kinematics.position(q))

    return np.asarray((place(h) - 2.0 * place(0.0) + place(-h)) / h**2)


def test_the_tool_accelerates_as_the_law_wants(
    carried: MovingBaseDynamics, limits: JointLimits, pose: BasePose, free: FreeBaseMotion
) -> None:
    law, kinematics = law_of(carried, limits), Kinematics(carried.robot)
    place = pose.to_world(kinematics.position(Q))
    velocity = pose.velocity + pose.rotation @ (
        np.cross(RATE, kinematics.position(Q)) + kinematics.position_jacobian(Q) @ DQ
    )
    off, slower, ddp = np.array([2e-3, -1e-3, 3e-3]), np.array([0.01, 0.02, -0.03]), np.ones(3)
    reference = WorldReference(place + off, velocity + slower, ddp, None, pose)
    tau = law.update(ArmState(Q, DQ, np.zeros(4)), reference, CYCLE, free).tau
    assert tau is not None
    moved = accelerations(carried, tau)
    wanted = ddp + law.gains.kp * off + law.gains.kd * slower
    reached = pose.rotation @ tool_acceleration(kinematics, moved[:6], moved[6:])
    assert reached == pytest.approx(wanted, abs=2e-3)


def test_orientation_is_led_where_the_place_leaves_a_joint_free(
    carried: MovingBaseDynamics, limits: JointLimits, pose: BasePose
) -> None:
    kinematics, zero = Kinematics(carried.robot), np.zeros(3)
    calm = FreeBaseMotion(BaseMotion(zero, zero, zero, zero), np.zeros(6), np.ones(6))
    pose = pose._replace(rate=zero, velocity=zero)
    transform = kinematics.transform(Q)
    place, turn = pose.to_world(transform[:3, 3]), pose.rotation @ transform[:3, :3]
    inverse, coupling = carried.whole.response(Q)
    answer, jacobian = inverse @ coupling, kinematics.jacobian(Q)
    task = jacobian[:3] - np.hstack([np.eye(3), -skew(kinematics.position(Q))]) @ answer
    turning = jacobian[3:] - answer[3:]
    # The one motion that leaves the tool's place, and what it turns the tool about.
    axis = turning @ np.linalg.svd(task)[2][3]
    axis = axis / np.linalg.norm(axis)
    wanted = pose.rotation @ _turned(0.2 * axis) @ pose.rotation.T @ turn
    found = []
    for weight in (0.0, 10.0):
        law = law_of(carried, limits, orientation_weight=weight)
        reference = WorldReference(place, zero, zero, wanted, pose)
        law.update(ArmState(Q, np.zeros(4), np.zeros(4)), reference, CYCLE, calm)
        found.append(law.ddq)
    assert axis @ turning @ (found[1] - found[0]) > 1.0
    # The place comes first, and does not see the difference.
    assert task @ (found[1] - found[0]) == pytest.approx(zero, abs=1e-6)


def skew(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def test_without_a_base_pose_the_arm_brakes_and_stays(
    carried: MovingBaseDynamics, limits: JointLimits
) -> None:
    law = law_of(carried, limits)
    stopped = WorldReference(np.zeros(3), np.zeros(3), np.zeros(3), None, None)
    q, dq = Q.copy(), DQ.copy()
    for _ in range(1500):
        law.update(ArmState(q, dq, np.zeros(4)), stopped, CYCLE)
        dq = dq + CYCLE * law.ddq
        q = q + CYCLE * dq
    assert law.is_stopped
    assert np.abs(dq).max() < 1e-3
    assert np.abs(q - Q).max() < 0.1


def test_joints_stay_within_their_limits(
    carried: MovingBaseDynamics, limits: JointLimits, pose: BasePose, free: FreeBaseMotion
) -> None:
    law = law_of(carried, limits)
    law.acceleration_max = limits.acceleration_max
    kinematics = Kinematics(carried.robot)
    far = pose.to_world(kinematics.position(Q)) + np.array([0.0, 0.4, 0.8])
    reference = WorldReference(far, np.zeros(3), np.zeros(3), None, pose)
    q, dq = Q.copy(), np.zeros(4)
    for _ in range(2000):
        law.update(ArmState(q, dq, np.zeros(4)), reference, CYCLE, free)
        dq = dq + CYCLE * law.ddq
        q = q + CYCLE * dq
        assert np.all(q > limits.position_min)
        assert np.all(q < limits.position_max)
        assert np.all(np.abs(dq) < 1.02 * limits.velocity_max)


def test_a_limit_of_the_reaction_changes_the_acceleration_but_not_braking_at_a_limit(
    carried: MovingBaseDynamics, limits: JointLimits, pose: BasePose, free: FreeBaseMotion
) -> None:
    law = law_of(carried, limits)
    target = WorldReference(np.array([0.3, 0.1, -0.5]), np.zeros(3), np.zeros(3), None, pose)
    state = ArmState(np.array([0.1, 1.2, 0.2, 1.4]), np.zeros(4), np.zeros(4))
    law.update(state, target, 1e-3, free)
    whole = law.ddq
    seen = []

    class Half:
        def __call__(self, q: Array, dq: Array, ddq: Array, dt: float) -> Array:
            seen.append(dt)
            return 0.5 * ddq

        def reset(self) -> None:
            seen.clear()

    law.limit = Half()
    law.update(state, target, 1e-3, free)
    assert seen == [1e-3]
    assert law.ddq == pytest.approx(0.5 * whole)
    q = state.q.copy()
    q[3] = limits.position_max[3]
    fast = ArmState(q, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(4))
    law.update(fast, target, 1e-3, free)
    assert law.ddq[3] < -30.0, 'it brakes at the position limit all the same'
    law.update(state, target._replace(base=None), 1e-3, free)
    assert seen == [], 'a stopped arm has no lasting reaction'
