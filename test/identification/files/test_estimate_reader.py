"""An estimate is the same after it was written and read."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import (
    estimate_yaml,
    estimated_arm,
    read_estimate,
)
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import TermKind

NOTHING = np.zeros(4)


def test_the_estimate_that_is_read_predicts_the_same_torque(
    result: IdentificationResult, robot: Robot, tmp_path: Path
) -> None:
    estimate = result.recommended.estimate
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(result, estimate, NOTHING, NOTHING))
    again = read_estimate(file, robot)
    bag = result.identification[0]
    wanted = bag.predict(estimate.model, estimate.theta).filtered
    np.testing.assert_allclose(bag.predict(again.model, again.theta).filtered, wanted, atol=1e-9)


def test_friction_that_builds_up_survives(
    result: IdentificationResult, robot: Robot, tmp_path: Path
) -> None:
    estimate = result.recommended.estimate
    dry = (TermKind.COULOMB, TermKind.LOAD)
    terms = tuple(
        tuple(replace(t, width=0.0, distance=0.01) if t.kind in dry else t for t in own)
        for own in estimate.model.terms
    )
    built_up = replace(estimate, model=replace(estimate.model, terms=terms))
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(result, built_up, NOTHING, NOTHING))
    again = read_estimate(file, robot)
    bag = result.identification[0]
    wanted, read = (bag.predict(e.model, e.theta).filtered for e in (built_up, again))
    np.testing.assert_allclose(read, wanted, atol=1e-9)
    assert np.abs(wanted - bag.predict(estimate.model, estimate.theta).filtered).max() > 1e-3


def test_gravity_is_that_of_the_estimate(
    result: IdentificationResult, robot: Robot, tmp_path: Path
) -> None:
    file = tmp_path / 'estimate.yaml'
    tilted = replace(result, robot=robot.with_gravity([0.1, 0.2, 9.7]))
    file.write_text(estimate_yaml(tilted, result.recommended.estimate, NOTHING, NOTHING))
    assert estimated_arm(file)[1] == pytest.approx([0.1, 0.2, 9.7])
    text = file.read_text()
    file.write_text(text.replace('gravity_in_base', 'another_key'))
    assert np.array_equal(estimated_arm(file, robot.gravity_in_base)[1], robot.gravity_in_base)
    file.write_text(text.replace('[0.1, 0.2, 9.7]', '[0.1, up]'))
    with pytest.raises(IdentificationError, match='gravity_in_base of .* is not three numbers'):
        estimated_arm(file, robot.gravity_in_base)


@pytest.mark.parametrize(
    ('distance', 'width', 'words'),
    [
        ('.nan', 0.0, 'coulomb_distance of joint2 .* is nan rad: use a finite'),
        ('-0.01', 0.0, 'coulomb_distance of joint2 .* is -0.01 rad: use a finite'),
        ('.inf', 0.0, 'coulomb_distance of joint2 .* is inf rad: use a finite'),
        ('0.01', 0.02, 'coulomb_distance and coulomb_width of joint2 .* both set'),
    ],
)
def test_impossible_distances_are_refused(
    result: IdentificationResult,
    robot: Robot,
    tmp_path: Path,
    distance: str,
    width: float,
    words: str,
) -> None:
    file = tmp_path / 'estimate.yaml'
    text = estimate_yaml(result, result.recommended.estimate, NOTHING, NOTHING)
    text = re.sub(r'coulomb_distance: .*', f'coulomb_distance: [0.0, {distance}, 0.0, 0.0]', text)
    text = re.sub(r'coulomb_width: .*', f'coulomb_width: [0.0, {width}, 0.0, 0.0]', text)
    file.write_text(text)
    with pytest.raises(IdentificationError, match=words):
        read_estimate(file, robot)


@pytest.mark.parametrize(
    ('old', 'new', 'words'),
    [
        ('joint3', 'elbow', r'has 4 joints \(joint1, joint2, elbow'),
        ('inertial_parameters: [', 'other: [', 'is not an estimate.yaml of an arm with 4 joints'),
        ('ros__parameters', 'parameters', 'is not an estimate.yaml'),
        ('coulomb: [', 'coulomb: [1.0, ', 'a list has a wrong length'),
    ],
)
def test_other_files_are_refused(
    result: IdentificationResult, robot: Robot, tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / 'estimate.yaml'
    text = estimate_yaml(result, result.recommended.estimate, NOTHING, NOTHING)
    file.write_text(text.replace(old, new))
    with pytest.raises(IdentificationError, match=words):
        read_estimate(file, robot)


def test_the_estimate_of_another_robot_is_refused(
    result: IdentificationResult, tmp_path: Path, example_urdf: Callable[[str], Path]
) -> None:
    """Four joints against six: the shape of the numbers is not what the user wants to read."""
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(result, result.recommended.estimate, NOTHING, NOTHING))
    with pytest.raises(
        IdentificationError, match=r'has 4 joints \(joint1, .* 6 \(shoulder_pan'
    ) as e:
        read_estimate(file, load_robot(example_urdf('ur10_robot.urdf')))
    assert '(--urdf)' in str(e.value)
    assert 'reshape' not in str(e.value)
