"""An estimate is the same after it was written as ROS parameters and read."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import (
    estimate_yaml,
    estimated_arm,
    read_estimate,
)
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import TermKind


def test_lists_have_one_type(result: IdentificationResult) -> None:
    """ROS refuses a list in which 0.0 was written as an integer."""
    text = estimate_yaml(result, result.recommended.estimate, np.full(4, 0.1), np.full(4, 0.2))

    def check(value: object) -> None:
        if isinstance(value, dict):
            for item in value.values():
                check(item)
        elif isinstance(value, list):
            assert len({type(item) for item in value}) == 1
            assert not isinstance(value[0], int)

    check(yaml.safe_load(text)['/**']['ros__parameters'])


NOTHING = np.zeros(4)


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
    ('old', 'new', 'words'),
    [
        ('joint3', 'elbow', r'has 4 joints \(joint1, joint2, elbow'),
        (r'inertial_parameters: \[', 'other: [', 'is not an estimate.yaml of an arm with 4 joints'),
        ('ros__parameters', 'parameters', 'is not an estimate.yaml'),
        (r' coulomb: \[', ' coulomb: [1.0, ', 'a list has a wrong length'),
        ('coulomb_distance: .*', 'coulomb_distance: [0, .nan, 0, 0]', 'of joint2 .* is nan rad'),
        ('coulomb_distance: .*', 'coulomb_distance: [0, 0.01, 0, 0]', 'of joint2 .* both set'),
    ],
)
def test_other_files_are_refused(
    result: IdentificationResult, robot: Robot, tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / 'estimate.yaml'
    text = estimate_yaml(result, result.recommended.estimate, NOTHING, NOTHING)
    text = re.sub(r'coulomb_width: .*', 'coulomb_width: [0.0, 0.02, 0.0, 0.0]', text)
    file.write_text(re.sub(old, new, text))
    with pytest.raises(IdentificationError, match=words):
        read_estimate(file, robot)
