"""Torque errors (5.3), extrapolation, and comparison with the true parameters."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from identified import identified

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult, torque_errors
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.truth import inertial_torque_errors, load_truth
from aerarm_ros.simulation.arm_plant import PlantParameters


def test_a_joint_of_which_nothing_was_measured_does_not_count() -> None:
    measured = np.array([[3.0, np.nan], [4.0, np.nan]])
    total, per_joint = torque_errors(measured, np.array([[3.0, 9.0], [3.0, 9.0]]))
    assert total == pytest.approx(20.0)
    assert np.array_equal(np.isnan(per_joint), [False, True])


def test_a_joint_that_rested_is_uncertain(make_arm: Callable, result: IdentificationResult) -> None:
    identification, validation = result.demands
    assert (identification.bag, validation.bag) == ('bag1', 'bag2')
    assert np.all(identification.beyond == 0.0)
    assert np.all(identification.uncertainty < result.fit.noise.std)
    assert not any('excites' in text for text in result.warnings)
    arm = make_arm()
    bag = arm.recording(1, noise=1.0)
    t, q, dq, ddq = arm.motion(1)
    q[:, 3] = q[0, 3]
    dq[:, 3] = ddq[:, 3] = 0.0
    noise = 0.05 * np.random.default_rng(0).standard_normal(q.shape)
    still = replace(bag, time=t, q=q, dq=dq, tau=arm.torque(q, dq, ddq) + noise)
    found = identified(still, bag)
    velocity = next(text for text in found.warnings if 'velocity leaves the range' in text)
    assert velocity.startswith('bag1: ')
    assert 'joint4, which hardly moves in the identification motion' in velocity
    assert any('hardly excites' in text and 'joint4' in text for text in found.warnings)
    assert 'fs_joint4' in found.only_prior
    assert found.demands[1].uncertainty[3] > 3.0 * found.demands[0].uncertainty[3]


def test_the_truth_as_currents_show_it_has_no_error(
    result: IdentificationResult, robot, config, tmp_path: Path
) -> None:
    """Wrong torque constants scale the measured torque: a share no estimate can remove."""
    file, model = tmp_path / 'truth.yaml', result.fit.model
    plant = PlantParameters.nominal(config, robot).perturbed(3)
    file.write_text(yaml.safe_dump(plant.as_dict()))
    truth = load_truth(file, model)
    estimate = Estimate('true', model, truth.vector(model))
    (error,) = inertial_torque_errors(truth, [estimate], result.validation)
    assert error.total_absolute == pytest.approx(0.0, abs=1e-9)
    off = 100.0 * np.abs(1.0 - 1.0 / truth.measured_per_true_torque)
    assert error.per_joint == pytest.approx(off, rel=1e-6)
    assert 0.0 < error.total < off.max()
    for text in ('parameters: {m_link1: 1.0}', '[1, 2]', '{'):
        file.write_text(text)
        with pytest.raises(IdentificationError, match='not a file of true parameters'):
            load_truth(file, model)
    with pytest.raises(IdentificationError, match='check the path'):
        load_truth(tmp_path / 'none.yaml', model)
