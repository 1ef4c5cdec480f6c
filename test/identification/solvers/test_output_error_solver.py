"""Friction by simulated positions."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.regression.model_fit import RegressionBank, fit_model
from aerarm_ros.identification.rollout import RolloutWindows, rollout_samples
from aerarm_ros.identification.solvers.output_error_solver import solve_output_error
from aerarm_ros.identification.solvers.solvers import solve_all


def test_friction_that_torque_shows_badly_gets_better(arm, robot: Robot, config: ArmConfig) -> None:
    """With noisy torque some viscous friction comes out as nil; positions know better."""
    options = IdentificationOptions(friction='coulomb', solvers=('output_error',), rollouts=True)
    bags = [arm.recording(seed, noise=1.0) for seed in (1, 2)]
    result = identify(robot, config, bags[:1], bags[1:], options, Stopwatch())
    refined, sdp = (result.solutions[name].estimate for name in ('output_error', 'sdp'))
    assert np.array_equal(refined.inertial, sdp.inertial)
    assert refined.physically_consistent
    off = [np.abs(each.joint_values('fv') - arm.viscous).sum() for each in (refined, sdp)]
    assert off[0] < 0.8 * off[1]
    held_out = {error.solver: error.total for error in result.rollouts}
    assert held_out['output_error'] < held_out['sdp'] < held_out['cad']


def test_without_a_window_there_is_no_solution(robot: Robot) -> None:
    model = JointModel.uniform(robot.joint_names, robot.link_names, THESIS_TERMS)
    nothing = np.zeros((0, 51, 4))
    windows = RolloutWindows(robot, 0.01, nothing, nothing, nothing)
    with pytest.raises(IdentificationError, match='no half-second'):
        solve_output_error(model, windows, np.ones(48), np.ones(8))


def test_its_estimate_has_the_friction_that_was_simulated(
    arm, robot: Robot, result: IdentificationResult
) -> None:
    """Simulations have no friction that builds up, so the fitted coefficients belong to `tanh`."""
    own = (JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB, distance=0.01), ROTOR)
    model = JointModel.uniform(robot.joint_names, robot.link_names, own)
    bank = RegressionBank(result.identification, own)
    fit = fit_model(result.identification, bank, model, result.cad)
    samples = [rollout_samples(result.conditioner, arm.recording(1).part(0.0, 0.3, ''))]
    windows = RolloutWindows.of(robot, samples)
    estimates = solve_all(fit, result.cad, names=['output_error'], windows=windows)
    dry = [each[1] for each in estimates['output_error'].model.terms]
    assert dry == [JointTerm(TermKind.COULOMB, width=0.02)] * 4
    assert estimates['sdp'].model == model
