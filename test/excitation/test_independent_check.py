"""Another engine confirms that no accepted motion collides or exceeds a limit.

`benchmarks/model_fits/excitation.py` repeats this with a thousand trajectories.
"""

import numpy as np
from mujoco_arm import MujocoArm, is_safe, with_landing_gear

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup, RandomTrajectory
from aerarm_ros.excitation.settings import ExcitationConfig

STEP = 0.01


def both_engines(
    robot: Robot, arm: ArmConfig, config: ExcitationConfig
) -> tuple[ExcitationSetup, MujocoArm]:
    """Return our checks of an arm, and another engine's."""
    other = MujocoArm(robot, arm.column('reflected_inertia'), config.ground_height)
    return ExcitationSetup.of_arm(robot, arm, config), other


def test_accepted_trajectories_are_safe_in_mujoco(
    robot, arm: ArmConfig, config: ExcitationConfig
) -> None:
    setup, other = both_engines(with_landing_gear(robot), arm, config)
    generator = np.random.default_rng(0)
    accepted = close = 0
    for _ in range(30):
        bias = np.array([0.0, generator.uniform(0.6, 2.5), 0.0, 0.0])
        trajectory = RandomTrajectory(bias, 0.3, generator.uniform(0.15, 0.5)).draw(generator)
        report = setup.checker.check_trajectory(trajectory, config.ramp_time, stop_early=True)
        if report.feasible:
            accepted += 1
            assert is_safe(setup, other, trajectory, STEP)
        elif 'clearance' in report.binding.limit:
            close += 1
    # Both happen, so the test is one.
    assert accepted > 5
    assert close > 5
