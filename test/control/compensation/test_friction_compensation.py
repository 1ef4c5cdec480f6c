import numpy as np
import pytest

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.model.regressor import viscous_coulomb

VISCOUS, COULOMB = np.array([0.006, 0.003]), np.array([0.25, 0.1])


def test_equals_the_friction_model_away_from_rest() -> None:
    compensation = FrictionCompensation(VISCOUS, COULOMB, width=0.03)
    for dq in (np.array([0.3, -0.5]), np.array([-2.0, 4.0])):
        np.testing.assert_allclose(
            compensation.torque(dq), viscous_coulomb(dq, VISCOUS, COULOMB), atol=1e-8
        )


def test_is_zero_at_rest_and_small_for_velocity_noise() -> None:
    compensation = FrictionCompensation(VISCOUS, COULOMB, width=0.03)
    assert not compensation.torque(np.zeros(2)).any()
    noise = np.random.default_rng(0).normal(scale=1e-3, size=(1000, 2))
    torques = np.array([compensation.torque(dq) for dq in noise])
    # A switching compensation would jump by 2 fs at every change of sign.
    assert np.all(np.abs(torques).max(axis=0) < 0.15 * COULOMB)


def test_a_loaded_gear_loses_a_fraction_of_the_transmitted_torque() -> None:
    share = np.array([0.04, 0.02])
    compensation = FrictionCompensation(VISCOUS, COULOMB, load_share=share)
    dq, load = np.array([0.5, -0.5]), np.array([-1.5, 2.0])
    np.testing.assert_allclose(
        compensation.torque(dq, load),
        viscous_coulomb(dq, VISCOUS, COULOMB + share * np.abs(load)),
        atol=1e-8,
    )
    np.testing.assert_array_equal(compensation.torque(np.zeros(2), load), np.zeros(2))


def test_with_a_fraction_below_one_friction_still_wins_at_every_velocity() -> None:
    compensation = FrictionCompensation(VISCOUS, COULOMB, fraction=0.8)
    for speed in np.linspace(-3.0, 3.0, 601):
        dq = np.full(2, speed)
        left = viscous_coulomb(dq, VISCOUS, COULOMB) - compensation.torque(dq)
        assert np.all(left * dq >= 0.0)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'fraction': 1.2}, 'fraction'),
        ({'width': 0.0}, 'width'),
        ({'coulomb': [-0.1, 0.1]}, 'Coulomb'),
        ({'coulomb': [0.1, 0.1, 0.1]}, '3 values'),
        ({'load_share': -0.1}, 'load-dependent friction'),
    ],
)
def test_wrong_coefficients_are_refused(changes, message) -> None:
    with pytest.raises(ValueError, match=message):
        FrictionCompensation(**{'viscous': VISCOUS, 'coulomb': COULOMB, **changes})


def test_slopes_are_the_derivatives_of_the_torque() -> None:
    friction = FrictionCompensation([0.1, 0.2], [0.3, 0.4], 0.05, load_share=[0.02, 0.04])
    dq, load, h = np.array([0.03, -0.4]), np.array([-2.0, 1.0]), 1e-7
    by_velocity, by_load = friction.slopes(dq, load)
    numeric = (friction.torque(dq + h, load) - friction.torque(dq - h, load)) / (2.0 * h)
    np.testing.assert_allclose(by_velocity, numeric, rtol=1e-5)
    numeric = (friction.torque(dq, load + h) - friction.torque(dq, load - h)) / (2.0 * h)
    np.testing.assert_allclose(by_load, numeric, rtol=1e-5)
