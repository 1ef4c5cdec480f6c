"""Another engine confirms that no accepted motion collides or exceeds a limit.

`benchmarks/model_fits/excitation.py` repeats this with a thousand trajectories.
"""

import numpy as np
import pytest
from boxed_arm import with_box
from mujoco_arm import MujocoArm

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup, RandomTrajectory
from aerarm_ros.excitation.settings import ExcitationConfig
from aerarm_ros.excitation.trajectory import RampedExcitation

LEGS = ''.join(
    f'<collision name="leg{i}"><origin xyz="{x} {y} 0.1"/>'
    '<geometry><box size="0.03 0.03 0.5"/></geometry></collision>'
    for i, (x, y) in enumerate([(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)])
)
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
    base = '<link name="base_link">'
    with_legs = load_robot(robot.urdf_text.replace(base, base + LEGS))
    setup, other = both_engines(with_legs, arm, config)
    generator = np.random.default_rng(0)
    accepted = close = 0
    for _ in range(60):
        bias = np.array([0.0, generator.uniform(0.6, 2.5), 0.0, 0.0])
        trajectory = RandomTrajectory(bias, 0.3, generator.uniform(0.15, 0.5)).draw(generator)
        report = setup.checker.check_trajectory(trajectory, config.ramp_time, stop_early=True)
        motion = RampedExcitation(trajectory, 1, config.ramp_time)
        states = motion.evaluate(np.arange(0.0, motion.duration, STEP))
        if report.feasible:
            accepted += 1
            itself, ground = np.array([other.distances(q) for q in states.q]).min(axis=0)
            assert itself >= config.self_clearance - 1e-5
            assert ground >= config.ground_clearance - 1e-5
            effort = np.array([other.effort(*s) for s in zip(*states, strict=True)])
            assert (np.abs(effort) <= setup.usable_limits.effort).all()
            current = np.abs(effort) / setup.torque_per_ampere
            assert (current <= setup.usable_limits.current).all()
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
