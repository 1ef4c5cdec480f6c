"""Causes of the residual, on simulated arms in which one cause at a time is switched on."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
from aerarm_ros.identification.residual_split import (
    DELAY,
    FLEXIBILITY,
    MOTION_NOISE,
    REVERSAL,
    RIPPLE,
    TORQUE_NOISE,
    ResidualSplit,
    white_noise,
)

GEAR = 23.0  # waves per turn of the joint
FAST = {'f0': 0.3, 'periods': 6}


def torque_noise(arm, states, random):
    states.effort = states.effort + 0.3 * random.standard_normal(states.effort.shape)


def motion_noise(arm, states, random):
    states.position = states.position + 2e-3 * random.standard_normal(states.position.shape)
    states.velocity = states.velocity + 2e-2 * random.standard_normal(states.velocity.shape)


def gear_ripple(arm, states, random):
    states.effort = states.effort + 0.1 * np.sin(GEAR * states.position + 0.4)


def joint_flexibility(arm, states, random):
    t = states.stamp - states.stamp[0]
    links = arm.torque(*arm.motion(3, **FAST)[1:])
    spline = CubicSpline(t, states.position + links / 300.0)
    motor, states.velocity = spline(t), spline(t, 1)
    arm = replace(arm)
    states.position = motor


def torque_delay(arm, states, random):
    t = states.stamp
    for joint in range(arm.robot.n):
        states.effort[:, joint] = np.interp(t - 0.012, t, states.effort[:, joint])


def friction_at_reversal(arm, states, random):
    """Friction that builds up over 20 mrad (Dahl), as load and Coulomb friction do not."""
    for joint, size in enumerate(arm.coulomb):
        state, last = 0.0, states.position[0, joint]
        for row, angle in enumerate(states.position[:, joint]):
            step, last = angle - last, angle
            state += step / 0.02 * (1.0 - state * np.sign(step))
            states.effort[row, joint] += size * (state - np.sign(states.velocity[row, joint]))


CAUSES = {
    TORQUE_NOISE: torque_noise,
    MOTION_NOISE: motion_noise,
    RIPPLE: gear_ripple,
    FLEXIBILITY: joint_flexibility,
    DELAY: torque_delay,
    REVERSAL: friction_at_reversal,
}


@pytest.fixture(scope='module')
def split_of(make_arm: Callable, robot: Robot, config: ArmConfig) -> Callable[[str], ResidualSplit]:
    def split(cause: str) -> ResidualSplit:
        arm = make_arm()
        states = arm.states(3, **FAST)
        CAUSES[cause](arm, states, np.random.default_rng(3))
        recording = recording_from_states('bag', states, robot.joint_names, JointMapping({}))
        options = IdentificationOptions(
            ConditioningOptions(
                exact_stamps=cause == DELAY,
                filter='butterworth' if cause == MOTION_NOISE else 'auto',
            ),
            friction='coulomb',
        )
        result = identify(robot, config, [recording], [], options, Stopwatch())
        return result.splits[0]

    return split


@pytest.mark.parametrize('cause', CAUSES)
def test_a_cause_that_acts_alone_has_the_largest_part(split_of: Callable, cause: str) -> None:
    split = split_of(cause)
    weight = split.rms**2
    parts = {name: float(np.average(p, weights=weight)) for name, p in split.fractions.items()}
    parts['unexplained'] = float(np.average(split.unexplained, weights=weight))
    assert max(parts, key=parts.get) == cause, parts
    assert parts[cause] > 0.5, parts
    assert sum(parts.values()) == pytest.approx(1.0)


def test_white_noise_is_found_beneath_a_motion() -> None:
    random, t = np.random.default_rng(1), np.arange(0.0, 20.0, 2e-3)
    motion = np.column_stack([np.sin(3.0 * t), 5.0 + t])
    found = white_noise(motion + random.standard_normal(motion.shape) * [0.01, 0.2])
    assert found == pytest.approx([0.01, 0.2], rel=0.1)
