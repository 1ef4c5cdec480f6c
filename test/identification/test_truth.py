"""Comparison with the true parameters of a simulated arm."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.truth import inertial_torque_errors, load_truth
from aerarm_ros.simulation.plant_parameters import PlantParameters


@pytest.fixture
def truth_file(tmp_path: Path, robot, config) -> Path:
    path = tmp_path / 'truth.yaml'
    plant = PlantParameters.nominal(config, robot).perturbed(3)
    path.write_text(yaml.safe_dump(plant.as_dict()))
    return path


def test_the_boards_file_is_understood(
    truth_file: Path, result: IdentificationResult, robot, config
) -> None:
    model = result.fit.model
    truth = load_truth(truth_file, model)
    plant = PlantParameters.nominal(config, robot).perturbed(3)
    theta = truth.vector(model)
    assert np.allclose(theta[:40].reshape(4, 10), plant.inertial_parameters)
    assert np.allclose(Estimate('', model, theta).joint_values('Ja'), plant.rotor_inertia)
    assert truth.value('fv_joint2') == pytest.approx(plant.viscous[1])
    assert truth.value('none') is None


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


def test_identification_comes_closer_than_cad(
    make_arm: Callable, result: IdentificationResult, tmp_path: Path
) -> None:
    arm = make_arm()
    names = result.fit.model.columns
    values = np.concatenate([arm.inertial.ravel(), arm.viscous, arm.coulomb, arm.rotor])
    path = tmp_path / 'truth.yaml'
    path.write_text(yaml.safe_dump({'parameters': dict(zip(names, values.tolist(), strict=True))}))
    truth = load_truth(path, result.fit.model)
    estimates = [solution.estimate for solution in result.solutions.values()]
    errors = inertial_torque_errors(truth, estimates, result.validation)
    total = {error.solver: error.total for error in errors}
    assert total['sdp'] < 0.5 < 3.0 < total['cad']


@pytest.mark.parametrize(
    'text',
    ['parameters: {m_link1: 1.0}', '[1, 2]', 'parameters: 3', '{', 'parameters: {m_link1: heavy}'],
)
def test_other_files_are_refused(tmp_path: Path, result: IdentificationResult, text: str) -> None:
    path = tmp_path / 'truth.yaml'
    path.write_text(text)
    with pytest.raises(IdentificationError, match='not a file of true parameters'):
        load_truth(path, result.fit.model)
    with pytest.raises(IdentificationError, match='check the path'):
        load_truth(tmp_path / 'none.yaml', result.fit.model)
