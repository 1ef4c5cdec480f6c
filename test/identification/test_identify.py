"""The whole way from recordings to estimates."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification import identify as identification
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.summary import ReportExtras, summarise
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.report import report_html


def true_values(arm, result: IdentificationResult, solver: str) -> np.ndarray:
    """Return the true parameters in the order of the estimate of one solver."""
    estimate = result.solutions[solver].estimate
    kinds = {'fv': arm.viscous, 'fs': arm.coulomb, 'Ja': arm.rotor, 'fl': arm.load}
    joints = [kinds[t.symbol][j] for j, t in estimate.model.joint_columns]
    return np.concatenate([arm.inertial.ravel(), joints])


def base_error(arm, result: IdentificationResult, solver: str) -> np.ndarray:
    """Return the errors of the base parameters of one solver."""
    found, true = result.solutions[solver].estimate.theta, true_values(arm, result, solver)
    return result.used_base.values(found) - result.used_base.values(true)


def test_exact_recovery_from_data_without_noise(make_arm: Callable) -> None:
    arm = make_arm()
    result = identified(arm.recording(1))
    assert (result.thesis_base.rank, result.used_base.rank) == (30, 32)
    assert np.abs(base_error(arm, result, 'ols')).max() < 2e-4
    for name in ('ols', 'sdp'):
        assert result.solutions[name].identification[0].filtered < 0.02


def test_noisy_data_are_explained_within_their_standard_deviations(
    arm, result: IdentificationResult
) -> None:
    normalised = base_error(arm, result, 'wls') / result.base_deviations
    assert np.abs(normalised).max() < 6.0
    assert 0.3 < np.sqrt(np.mean(normalised**2)) < 2.5
    cad, sdp = result.solutions['cad'], result.recommended
    assert sdp.estimate.physically_consistent
    assert sdp.estimate.min_pseudo_inertia_eigenvalue > 0.0
    assert sdp.validation[0].filtered < 0.2 * cad.validation[0].filtered
    assert np.all(sdp.estimate.std > 0.0)
    assert np.all((sdp.estimate.determined >= 0.0) & (sdp.estimate.determined <= 1.0))


def test_wrong_torque_constants_yield_the_base_parameters_that_currents_show(arm) -> None:
    """Each joint's torque is scaled; what a fit to it without noise yields is no error."""
    gains, bag = np.array([1.02, 0.98, 1.01, 0.99]), arm.recording(1, noise=1.0)
    result = identified(replace(bag, tau=bag.tau * gains))
    true, rows, torque = true_values(arm, result, 'sdp'), [], []
    fit = result.fit
    for factor, gain, w in zip(fit.regression.factors, gains, fit.noise.weights, strict=True):
        rows.append(w * factor[:, :-1])
        torque.append(gain * rows[-1] @ true)
    shown = np.linalg.lstsq(np.vstack(rows), np.hstack(torque), rcond=None)[0]
    std, error = result.base_deviations, base_error(arm, result, 'sdp')
    assert np.abs(error / std).max() > 20.0
    error += result.used_base.values(true) - result.used_base.values(shown)
    assert np.abs(error / std).max() < 4.0


def test_load_dependent_friction_is_chosen_and_measured(make_arm: Callable) -> None:
    arm = make_arm(load=0.05)
    bags = [arm.recording(seed, noise=1.0) for seed in (1, 2)]
    automatic, plain = (identified(*bags, friction=name) for name in ('auto', 'coulomb'))
    load = automatic.recommended.estimate.joint_values('fl')
    assert load[1] == pytest.approx(0.05, rel=0.1)
    errors = [r.recommended.validation[0].filtered for r in (automatic, plain)]
    assert errors[0] < 0.7 * errors[1]


def test_a_dead_sensor_leaves_the_other_joints_identified(arm) -> None:
    bag = arm.recording(1, noise=1.0)
    tau = bag.tau.copy()
    tau[:, 3] = 0.3
    dead = np.array([False, False, False, True])
    result = identified(replace(bag, tau=tau, dead_effort=dead))
    errors = result.recommended.identification[0]
    assert max(errors.filtered, *errors.per_joint_filtered[:3]) < 8.0
    assert np.isnan(errors.per_joint_filtered[3])
    entry = summarise(result, {}, ReportExtras())['solvers']['sdp']['identification'][0]
    assert entry['per_joint_raw'][3] is None
    assert result.recommended.estimate.physically_consistent
    assert "Plotly.newPlot('friction'" in report_html(result, ReportExtras()).replace('"', "'")


def test_rows_count_by_one_over_their_noise(
    make_arm: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = make_arm(rate=200.0)
    bags = [arm.recording(1, noise=0.5), arm.recording(3, noise=8.0)]
    errors = []
    for most in (10.0, 1.0):  # the second leaves all weights at one
        monkeypatch.setattr(identification, '_MOST', most)
        result = identified(bags, arm.recording(2), solvers=())
        errors.append(result.recommended.validation[0].filtered)
        quiet, noisy = (bag.weights for bag in result.identification)
        if most > 1.0:
            assert quiet / noisy == pytest.approx(np.full(4, 16.0), rel=0.4)
    assert errors[0] < 0.8 * errors[1]


def test_rotors_that_a_sensor_behind_the_gear_does_not_feel(
    make_arm: Callable, robot: Robot
) -> None:
    arm = make_arm(rate=100.0)
    without = replace(arm, rotor=np.array([0.0, 1.0, 0.0, 1.0]) * arm.rotor)
    # Less than nothing: no data say "exactly none".
    recording = without.recording(1, noise=0.5)
    t, _, _, ddq = without.motion(1)
    rows = np.searchsorted(t, recording.time - 1e-9)
    less = np.array([0.0, 0.0, 0.02, 0.0])
    found = identified(replace(recording, tau=recording.tau - less * ddq[rows]), robot=robot)
    assert 'Ja_joint3' in found.left_out
    assert set(found.left_out) & {'Ja_joint2', 'Ja_joint4', 'fs_joint1', 'fv_joint2'} == set()
    assert not set(found.left_out) & set(found.fit.model.columns)
    assert all(own.estimate.model == found.fit.model for own in found.solutions.values())
    assert found.recommended.estimate.physically_consistent
    assert any('Ja_joint3' in text and 'behind the gears' in text for text in found.warnings)


def test_a_bag_without_velocities_does_as_well(arm, result: IdentificationResult) -> None:
    without = identified(replace(arm.recording(1, noise=1.0), dq=None))
    assert without.filter_choice.kinematics.from_position
    measured = result.recommended.identification[0].filtered
    assert without.recommended.identification[0].filtered < 1.2 * (measured + 0.1)


def test_too_little_motion_is_refused(arm) -> None:
    bag = arm.recording(1)
    with pytest.raises(IdentificationError, match='too short'):
        identified(bag.part(0.4, 0.4 + 1.5 / bag.duration, ''))
