"""estimate.yaml is what ROS parameters look like."""

import numpy as np
import pytest
import yaml

from aerarm_ros.identification.files.estimate_file import estimate_yaml
from aerarm_ros.identification.identification_result import IdentificationResult


@pytest.fixture(scope='module')
def parameters(result: IdentificationResult) -> dict:
    estimate = result.recommended.estimate
    text = estimate_yaml(result, estimate, np.full(4, 0.1), np.full(4, 0.2))
    return yaml.safe_load(text)['/**']['ros__parameters']


def test_values_survive_exactly(result: IdentificationResult, parameters: dict) -> None:
    estimate = result.recommended.estimate
    assert parameters['joint_names'] == list(result.robot.joint_names)
    assert np.array_equal(parameters['inertial_parameters'], estimate.inertial.ravel())
    assert np.array_equal(parameters['rotor_inertia'], estimate.joint_values('Ja'))
    assert np.array_equal(parameters['friction']['coulomb'], estimate.joint_values('fs'))
    assert parameters['viscous'] == [0.1] * 4
    assert np.array_equal(
        parameters['standard_deviation']['inertial_parameters'], estimate.std[:40]
    )


def test_base_parameters_have_deviations(result: IdentificationResult, parameters: dict) -> None:
    base = parameters['base_parameters']
    assert np.array_equal(base['standard_deviations'], result.base_deviations)
    assert len(base['values']) == len(base['expressions']) == len(base['standard_deviations'])
    assert min(base['standard_deviations']) > 0.0


def test_lists_have_one_type(parameters: dict) -> None:
    """ROS refuses a list in which 0.0 was written as an integer."""

    def check(value: object) -> None:
        if isinstance(value, dict):
            for item in value.values():
                check(item)
        elif isinstance(value, list):
            assert len({type(item) for item in value}) == 1
            assert not isinstance(value[0], int)

    check(parameters)
