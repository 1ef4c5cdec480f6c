"""A fit knows the noise it leaves."""

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult


def test_noise_is_that_of_the_simulated_torque_sensor(result: IdentificationResult) -> None:
    """White noise of 0.05 Nm at 500 Hz, after a low-pass that leaves about 5 of 250 Hz."""
    expected = 0.05 * np.sqrt(5.0 / 250.0)
    assert np.all(result.fit.noise.std < 2.0 * expected)
    assert np.all(result.fit.noise.std > 0.5 * expected)


def test_the_fit_is_close_to_weighted_least_squares(result: IdentificationResult) -> None:
    fit = result.fit
    wls = result.solutions['wls'].estimate.theta
    assert fit.regression.error(fit.theta) < 1.05 * fit.regression.error(wls) + 0.01
    assert np.array_equal(fit.inertial, fit.theta[:40])
