"""Another engine confirms that no accepted motion collides or exceeds a limit.

`benchmarks/model_fits/excitation.py` repeats this with a thousand trajectories.
"""

import numpy as np
import pytest
from boxed_arm import with_box
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


def test_both_engines_detect_collisions_of_link_1(
    robot, arm: ArmConfig, config: ExcitationConfig
) -> None:
    # Reached by the corners of link 1's fork plate, and by nothing else.
    beside = with_box(robot, '0.058 0 0.11', '0.02 0.01 0.02')
    setup, other = both_engines(beside, arm, config)
    itself = [i for i, pair in enumerate(setup.clearance.pairs) if 'ground' not in pair]
    hits = 0
    for angle in np.linspace(-2.9, 2.9, 59):
        q = np.array([angle, np.pi / 2, 0.0, 0.0])
        theirs, _ = other.distances(q)
        ours = setup.clearance.distances(q)[itself].min()
        hits += ours < 0.0
        # Depths of overlap are told by other methods; distances agree.
        if ours > 0.0:
            assert theirs == pytest.approx(ours, abs=1e-4)
        else:
            assert theirs <= 1e-6
    assert hits > 5
