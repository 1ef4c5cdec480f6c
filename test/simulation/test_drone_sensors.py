"""Errors of IMU, odometry and wind have the specified sizes, and repeat with the seed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.simulation.sensors import (
    DelayedSensor,
    FaultyImu,
    NoisyOdometry,
    RandomDrift,
    turned,
)

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
FORCE = np.array([0.0, 0.0, 9.81])


def test_readings_have_the_configured_rate_and_delay() -> None:
    clock = iter(range(100))
    sensor = DelayedSensor(lambda: next(clock), rate=250.0, cycle=1e-3, delay=0.01)
    told = {k: sensor.update(k * 1_000_000) for k in range(30)}
    arrived = {k: reading for k, reading in told.items() if reading is not None}
    assert arrived == {10 + 4 * i: (4_000_000 * i, i) for i in range(5)}
    assert sensor.period_ns == 4_000_000


def test_the_imu_s_errors_have_their_sizes() -> None:
    errors = {'force_noise': 0.3, 'rate_noise': 0.02, 'force_bias': 0.2, 'rate_bias': 0.01}
    imu = FaultyImu(0.004, seed=1, **errors)
    readings = [imu.apply((LEVEL, np.zeros(3), FORCE)) for _ in range(4000)]
    rates, forces = (np.array([reading[k] for reading in readings]) for k in (1, 2))
    np.testing.assert_allclose(forces.std(axis=0), 0.3, rtol=0.05)
    np.testing.assert_allclose(rates.std(axis=0), 0.02, rtol=0.05)
    bias = forces.mean(axis=0) - FORCE
    assert 0.02 < np.linalg.norm(bias) < 1.0
    again = FaultyImu(0.004, seed=1, **errors).apply((LEVEL, np.zeros(3), FORCE))
    np.testing.assert_array_equal(again[2], readings[0][2])


def test_odometry_is_noisy_in_each_part() -> None:
    odometry = NoisyOdometry(3, (0.01, 0.03, 0.002, 0.02))
    readings = [odometry.apply((FORCE, LEVEL, FORCE, FORCE)) for _ in range(4000)]
    for part, deviation in ((0, 0.01), (2, 0.03), (3, 0.02)):
        values = np.array([reading[part] for reading in readings])
        np.testing.assert_allclose(values.std(axis=0), deviation, rtol=0.06)
        np.testing.assert_allclose(values.mean(axis=0), FORCE, atol=4 * deviation / 60)
    angles = 2.0 * np.array([reading[1][:3] for reading in readings])
    np.testing.assert_allclose(angles.std(axis=0), 0.002, rtol=0.06)


def test_drift_has_the_configured_size_and_correlation_time() -> None:
    drift = RandomDrift(2.0, 0.05, 1e-3, np.random.default_rng(4))
    values = np.array([drift.update() for _ in range(60_000)])
    np.testing.assert_allclose(values.std(axis=0), 2.0, rtol=0.1)
    lagged = np.mean(values[50:] * values[:-50], axis=0) / np.mean(values**2, axis=0)
    np.testing.assert_allclose(lagged, np.exp(-1.0), atol=0.06)


@pytest.mark.parametrize('seed', range(3))
def test_a_small_turn_is_one_about_the_body_s_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, angle = Rotation.random(random_state=seed), 1e-4 * rng.standard_normal(3)
    after = Rotation.from_quat(turned(before.as_quat(), angle))
    np.testing.assert_allclose((before.inv() * after).as_rotvec(), angle, atol=1e-11)
