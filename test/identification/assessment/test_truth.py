"""Comparison with the true parameters of a simulated arm."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.truth import Truth, inertial_torque_errors, load_truth
from aerarm_ros.simulation.arm_plant import PlantParameters


@pytest.fixture
def truth_file(tmp_path: Path, robot, config) -> Path:
    path = tmp_path / 'truth.yaml'
    plant = PlantParameters.nominal(config, robot).perturbed(3)
    path.write_text(yaml.safe_dump(plant.as_dict()))
    return path


def test_error_is_zero_for_the_truth_as_currents_show_it(
    truth_file: Path, result: IdentificationResult
) -> None:
    """Wrong torque constants scale the measured torque: a share no estimate can remove."""
    model = result.fit.model
    truth = load_truth(truth_file, model)
    estimate = Estimate('true', model, truth.vector(model))
    (error,) = inertial_torque_errors(truth, [estimate], result.validation)
    assert error.total_absolute == pytest.approx(0.0, abs=1e-9)
    off = 100.0 * np.abs(1.0 - 1.0 / truth.measured_per_true_torque)
    assert error.per_joint == pytest.approx(off, rel=1e-6)
    assert 0.0 < error.total < off.max()


def truth_of(arm, model, gains: np.ndarray) -> Truth:
    values = np.concatenate([arm.inertial.ravel(), arm.viscous, arm.coulomb, arm.rotor])
    return Truth(dict(zip(model.columns, values, strict=True)), np.zeros(4), gains)


def test_identified_base_parameters_are_those_that_currents_show(
    make_arm: Callable, robot, config
) -> None:
    """Other torque constants than stated are no error of the estimate."""
    arm, gains = make_arm(), np.array([1.02, 0.98, 1.01, 0.99])
    states = arm.states(1, noise=1.0)
    states = replace(states, effort=states.effort * gains)
    recording = recording_from_states('bag', states, robot.joint_names, JointMapping({}))
    options = IdentificationOptions(friction='coulomb')
    found = identify(robot, config, [recording], [], options, Stopwatch())
    truth = truth_of(arm, found.fit.model, gains)
    values = found.used_base.values(found.recommended.estimate.theta)
    std = found.base_deviations
    off = np.abs(values - truth.measured_base_values(found.fit, found.used_base)) / std
    assert off.max() < 4.0
    unscaled = np.abs(values - truth.base_values(found.fit, found.used_base)) / std
    assert unscaled.max() > 20.0


@pytest.mark.parametrize('text', ['parameters: {m_link1: 1.0}', '[1, 2]', '{'])
def test_other_files_are_refused(tmp_path: Path, result: IdentificationResult, text: str) -> None:
    path = tmp_path / 'truth.yaml'
    path.write_text(text)
    with pytest.raises(IdentificationError, match='not a file of true parameters'):
        load_truth(path, result.fit.model)
    with pytest.raises(IdentificationError, match='check the path'):
        load_truth(tmp_path / 'none.yaml', result.fit.model)
