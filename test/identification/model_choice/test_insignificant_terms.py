"""Terms that come out as nil leave the model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identify import (
    IdentificationOptions,
    Stopwatch,
    identify,
    without_insignificant_terms,
)


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
    recording = replace(recording, tau=recording.tau - less * ddq[rows])
    options = IdentificationOptions(friction='coulomb')
    found = identify(robot, None, [recording], [], options, Stopwatch())
    assert 'Ja_joint3' in found.left_out
    assert set(found.left_out) & {'Ja_joint2', 'Ja_joint4', 'fs_joint1', 'fv_joint2'} == set()
    assert not set(found.left_out) & set(found.fit.model.columns)
    for solution in found.solutions.values():
        assert solution.estimate.model == found.fit.model
    assert found.recommended.estimate.physically_consistent
    assert any('Ja_joint3' in text and 'behind the gears' in text for text in found.warnings)


def test_nothing_is_fitted_again_without_need(result) -> None:
    fit, left_out = without_insignificant_terms(
        result.fit, result.recommended.estimate, result.identification, result.cad
    )
    assert fit is result.fit
    assert left_out == []
