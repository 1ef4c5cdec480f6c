"""Each common error of a recording is named, and implausible results say what to check.

The measured arm has bodies of another size and density than drawn, friction, rotors and noise.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.input_errors import bound_warnings, joint_warnings
from aerarm_ros.identification.joint_model import JointTerm, TermKind
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


@pytest.fixture(scope='module')
def of_factors(make_arm: Callable, robot: Robot, config: ArmConfig) -> Callable[..., str]:
    """Return a function that identifies from torques times factors, and returns the warnings."""
    recording = make_arm(rate=100.0).recording(1, noise=1.0)

    def run(*factors: float) -> str:
        changed = replace(recording, tau=recording.tau * factors)
        options = IdentificationOptions(friction='coulomb')
        return ' '.join(identify(robot, config, [changed], [], options, Stopwatch()).warnings)

    return run


def test_efforts_in_another_unit(of_factors: Callable[..., str]) -> None:
    text = of_factors(20.0, 20.0, 20.0, 20.0)
    assert 'the effort of joint2 is 2' in text
    assert 'times the modelled torque' in text


def test_bounds_that_hold_an_estimate(result: IdentificationResult) -> None:
    """Masses at half of CAD's, and friction that the data want to be negative."""
    estimate, fit = result.recommended.estimate, result.fit
    mass = estimate.inertial[:, 0]
    assert bound_warnings(estimate, fit, mass) == []
    assert 'mass of link1, link2, link3, link4 is at its bound, half' in ' '.join(
        bound_warnings(estimate, fit, 2.0 * mass)
    )
    first = 10 * fit.model.n
    held, wanted = np.array(estimate.theta), np.array(fit.theta)
    held[first], wanted[first] = 0.0, -1.0
    (text,) = bound_warnings(replace(estimate, theta=held), replace(fit, theta=wanted), mass)
    assert text.startswith(
        f'the terms {fit.model.columns[first]} are omitted, because their values are negative'
    )


def test_a_joint_that_only_validation_fails_to_predict(result: IdentificationResult) -> None:
    solution = result.recommended
    joints = result.robot.joint_names
    assert joint_warnings(solution, joints) == []
    poor = [replace(b, per_joint_filtered=np.array([1, 2, 35, 4])) for b in solution.validation]
    (text,) = joint_warnings(replace(solution, validation=poor), joints)
    assert 'in validation (residual joint3 35 %)' in text
    assert joint_warnings(replace(solution, validation=[]), joints) == []


def test_friction_that_takes_all_of_the_load(result: IdentificationResult) -> None:
    estimate, fit = result.recommended.estimate, result.fit
    load = JointTerm(TermKind.LOAD)
    terms = tuple((load, *own) if joint == 1 else own for joint, own in enumerate(fit.model.terms))
    model = replace(fit.model, terms=terms)
    index = model.columns.index('fl_joint2')
    theta, std = (np.insert(values, index, 1.0) for values in (estimate.theta, estimate.std))
    full = replace(estimate, model=model, theta=theta, std=std)
    (text,) = bound_warnings(full, replace(fit, model=model, theta=theta), full.inertial[:, 0])
    assert text.startswith('the load-dependent friction fl_joint2 is at its upper bound 1')


def test_a_joint_that_another_one_drives(
    make_arm: Callable, robot: Robot, config: ArmConfig
) -> None:
    """The residual says whose motion it follows, until the coupling is given."""
    plain = make_arm(rate=100.0).recording(1)
    recording = replace(plain, tau=plain.tau + 8.0 * plain.dq[:, [1]] * [0.0, 0.0, 0.0, 1.0])
    options = IdentificationOptions(friction='coulomb')
    for coupled, said in (((), True), ((('joint4', 'joint2'),), False)):
        chosen = replace(options, coupled=coupled)
        found = identify(robot, config, [recording], [], chosen, Stopwatch())
        text = ' '.join(found.warnings)
        assert ('--coupled joint4=joint2' in text) == said
        assert ('explains little of the torque of some joints (residual joint4' in text) == said
