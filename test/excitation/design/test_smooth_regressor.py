"""The differentiable regressor against the exact one and against finite differences."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.criteria import SmoothRegressor
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import JointReference


def states_of(trajectory: FourierTrajectory) -> JointReference:
    return trajectory.evaluate(np.linspace(0.0, 10.0, 40, endpoint=False))


def test_is_the_exact_regressor_away_from_standstill(
    robot: Robot, trajectory: FourierTrajectory
) -> None:
    states = states_of(trajectory)
    smooth = SmoothRegressor(robot, width=1e-9).stack(states)
    exact = Regressor(robot, rotor_inertia=True).stack(*states)
    np.testing.assert_allclose(smooth.reshape(exact.shape), exact, atol=1e-12)


def test_times_the_prior_it_is_the_torque(
    robot: Robot, arm: ArmConfig, setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    states = states_of(trajectory)
    regressor = SmoothRegressor(robot, width=1e-9)
    prior = Regressor(robot, rotor_inertia=True).parameters(
        robot.inertial_parameters, robot.viscous, robot.coulomb, arm.column('reflected_inertia')
    )
    np.testing.assert_allclose(
        regressor.stack(states) @ prior, setup.effort_model.effort(*states), atol=1e-10
    )


def test_derivatives_by_central_differences(robot: Robot, trajectory: FourierTrajectory) -> None:
    regressor, states, step = SmoothRegressor(robot), states_of(trajectory), 1e-4
    for kind, joint, derivative in regressor.derivatives(states, regressor.stack(states)):
        shifted = []
        for sign in (1.0, -1.0):
            moved = [part.copy() for part in states]
            moved[kind][:, joint] += sign * step
            shifted.append(regressor.stack(JointReference(*moved)))
        numeric = (shifted[0] - shifted[1]) / (2.0 * step)
        np.testing.assert_allclose(derivative, numeric, atol=2e-4)
