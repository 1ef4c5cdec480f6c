"""The prior of the geometric errors, and its weight relative to correlated measurements."""

from dataclasses import replace

import numpy as np
from measured_arm import LINK, ROBOT, MeasuredArm

from aerarm_ros.calibration.choice import LEVELS, identifiable
from aerarm_ros.calibration.fit import Fit, fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry, Tolerance
from aerarm_ros.calibration.observations import MarkerSource, Observations


def displaced(observations: Observations, size: float, seed: int = 0) -> Observations:
    """Return measurements in which all markers of a posture have the same error."""
    source = observations.sources[0]
    assert isinstance(source, MarkerSource)
    error = size * np.random.default_rng(seed).normal(size=(len(observations), 1, 3))
    return replace(observations, sources=(replace(source, position=source.position + error),))


def geometry_fit(observations: Observations, tolerance: Tolerance | None = None) -> Fit:
    start = registered(ArmGeometry(ROBOT, LINK, tolerance), observations)
    return fitted(start, identifiable(start, LEVELS['geometry']).columns)


def test_equal_errors_of_four_markers_count_as_one_measurement() -> None:
    arm = MeasuredArm(4)
    observations = arm.observe(arm.postures(60))
    assert geometry_fit(observations).repeats < 1.3
    assert 3.5 < geometry_fit(displaced(observations, 2e-3)).repeats < 5.0


def test_a_small_tolerance_keeps_the_urdf() -> None:
    arm = MeasuredArm(4)
    observations = arm.observe(arm.postures(25))
    free = geometry_fit(observations)
    kept = geometry_fit(observations, Tolerance(1e-6, 5e-6))
    assert np.abs(free.errors).max() > 5e-3
    assert np.abs(kept.errors).max() < 1e-3


def test_zero_errors_of_11_degrees_are_found_from_one_marker_in_20_postures() -> None:
    arm = MeasuredArm(3)
    arm.made.offsets[:] += 0.2 * np.random.default_rng(3).choice([-1.0, 1.0], ROBOT.n)
    whole = arm.observe(arm.postures(40))
    source = whole.sources[0]
    assert isinstance(source, MarkerSource)
    one = MarkerSource('mocap', ('tip',), source.position[:, :1])
    observations = replace(whole, sources=(one,))
    fit = geometry_fit(observations.rows(range(20)))
    error = fit.residuals(observations.rows(range(20, 40)))[0]
    assert np.sqrt(np.nanmean(error**2)) < 1e-3
