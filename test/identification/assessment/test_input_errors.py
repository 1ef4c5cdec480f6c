"""Each common error of a recording is recognized by its pattern, named, and not taken for another.

The measured arm is not the drawn one: bodies of other size and density, friction, rotors, noise.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import Recording

Change = Callable[[Recording], Recording]


def scaled(joint: int, factor: float) -> Change:
    factors = np.ones(4)
    factors[joint] = factor
    return lambda recording: replace(recording, tau=recording.tau * factors)


def swapped(one: int, other: int) -> Change:
    order = np.arange(4)
    order[[one, other]] = other, one

    def change(recording: Recording) -> Recording:
        arrays = {name: getattr(recording, name)[:, order] for name in ('q', 'dq', 'tau')}
        return replace(recording, **arrays)

    return change


def shifted(joint: int, degrees: float) -> Change:
    return lambda recording: replace(
        recording, q=recording.q + np.radians(degrees) * (np.arange(4) == joint)
    )


@pytest.fixture(scope='module')
def warnings(make_arm: Callable, robot: Robot, config: ArmConfig) -> Callable[[Change], list[str]]:
    recording = make_arm(rate=100.0).recording(1, noise=1.0)
    options = IdentificationOptions(friction='coulomb')

    def run(change: Change) -> list[str]:
        found = identify(robot, config, [change(recording)], [], options, Stopwatch())
        return found.warnings

    return run


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (scaled(1, -1.0), 'the effort of joint2 has the opposite sign'),
        (scaled(2, -1.0), 'the effort of joint3 has the opposite sign'),
        (swapped(1, 3), '--rename joint2=joint4 joint4=joint2'),
        (swapped(0, 1), '--rename joint1=joint2 joint2=joint1'),
        (shifted(1, 90.0), 'the zero position of joint2 is off by +90 degrees'),
        (shifted(1, -90.0), 'the zero position of joint2 is off by -90 degrees'),
        (scaled(0, 2.0), 'the effort of joint1 is 2 times'),
        (scaled(1, 2.0), 'the effort of joint2 is 2 times'),
    ],
)
def test_the_error_is_named(
    change: Change, words: str, warnings: Callable[[Change], list[str]]
) -> None:
    found = [text for text in warnings(change) if 'a simple model leaves' in text]
    assert len(found) == 1, warnings(change)
    assert words in found[0]


def test_correct_data_cause_no_warning(warnings: Callable[[Change], list[str]]) -> None:
    assert not [text for text in warnings(lambda same: same) if 'a simple model leaves' in text]


def test_a_urdf_without_friction_suggests_no_effort_factor(
    make_arm: Callable, robot: Robot, config: ArmConfig
) -> None:
    """Joint 1 turns about gravity, slowly: the drawing asks for next to no torque of it."""
    arm = make_arm(rate=100.0, friction=10.0)
    recording = arm.recording(1, noise=1.0)
    options = IdentificationOptions(friction='coulomb')
    found = identify(robot, None, [recording], [], options, Stopwatch())
    assert found.solutions['cad'].identification[0].per_joint_filtered[0] > 80.0
    assert 'times the modelled torque' not in ' '.join(found.warnings)
    friction = found.solutions['cad_friction'].identification[0].filtered
    assert friction < 0.5 * found.solutions['cad'].identification[0].filtered
