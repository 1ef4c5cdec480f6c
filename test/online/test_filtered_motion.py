import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.filtered_motion import FilteredMotion, MotionRow

PAYLOAD = parameters_of_body(0.3, [0.1, 0.02, -0.03], np.diag([1e-3, 2e-3, 2.5e-3]))
ROTORS = 0.01
FRICTION = np.array([[0.02] * 4, [0.2, 0.1, 0.1, 0.1], [0.04, 0.02, 0.04, 0.02]])
RATES = np.array([2.0, 3.0, 2.5, 4.0])


def swing(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angle = RATES * time + np.arange(4)
    return np.sin(angle), RATES * np.cos(angle), -(RATES**2) * np.sin(angle)


def sway(time: float) -> BaseMotion:
    """A base that turns about x while it is pushed about."""
    rate, spin = 0.8 * np.cos(2.0 * time), -1.6 * np.sin(2.0 * time)
    force = np.array([np.sin(3.0 * time), 0.5, 9.81 + np.cos(3.0 * time)])
    x = np.array([1.0, 0.0, 0.0])
    return BaseMotion(-force, force, rate * x, spin * x)


def play(robot: Robot, is_swaying: bool, friction: np.ndarray) -> MotionRow:
    """Move a loaded arm with friction; return the result of a filter without either."""
    loaded, bare = MovingBaseDynamics(robot, ROTORS), MovingBaseDynamics(robot, ROTORS)
    loaded.carry(PAYLOAD)
    motion = FilteredMotion(bare, *friction, 30.0)
    for step in range(1, 1201):
        # Torque is the mean of a cycle: at its middle.
        q, dq, ddq = swing(1e-3 * (step - 0.5))
        base = sway(1e-3 * (step - 0.5)) if is_swaying else bare.still
        tau = loaded.inverse(q, dq, ddq, base)
        viscous, coulomb, share = FRICTION
        torque = tau + viscous * dq + (coulomb + share * np.abs(tau)) * np.tanh(dq / 0.01)
        q, dq, _ = swing(1e-3 * step)
        base = sway(1e-3 * step) if is_swaying else bare.still
        motion.update(ArmState(q, dq, torque), 1e-3, base)
    assert motion.is_settled
    return motion.row()


@pytest.mark.parametrize('is_swaying', [False, True])
def test_the_residual_is_the_torque_of_the_payload(robot: Robot, is_swaying: bool) -> None:
    row = play(robot, is_swaying, FRICTION)
    np.testing.assert_allclose(row.regressor[:, :10] @ PAYLOAD, row.torque, atol=5e-3)
    assert np.abs(row.torque).max() > 0.3


def test_friction_that_is_not_known_is_in_the_regressor(robot: Robot) -> None:
    row = play(robot, False, np.zeros((3, 4)))
    explained = row.regressor @ np.concatenate([PAYLOAD, FRICTION.ravel()])
    np.testing.assert_allclose(explained, row.torque, atol=0.01)
