"""Run-in and run-out along the trajectory."""

import numpy as np
import pytest
from derivatives import assert_derivatives_agree

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation

RAMP = 2.0


@pytest.fixture
def ramped(trajectory: FourierTrajectory) -> RampedExcitation:
    return RampedExcitation(trajectory, periods=2, ramp_time=RAMP)


def test_starts_and_ends_at_rest(ramped: RampedExcitation) -> None:
    for time in (0.0, ramped.duration):
        reference = ramped.evaluate(time)
        np.testing.assert_allclose(reference.dq, 0.0, atol=1e-12)
        np.testing.assert_allclose(reference.ddq, 0.0, atol=1e-12)


def test_position_velocity_and_acceleration_are_continuous(ramped: RampedExcitation) -> None:
    time = np.linspace(0.0, ramped.duration, 24001)
    assert_derivatives_agree(time, ramped.evaluate(time), of_position=1e-4, of_velocity=1e-2)


def test_the_middle_is_whole_periods_of_the_trajectory(
    ramped: RampedExcitation, trajectory: FourierTrajectory
) -> None:
    assert ramped.periodic_duration == pytest.approx(20.0)
    time = np.linspace(0.0, ramped.periodic_duration, 501)
    played, wanted = ramped.evaluate(RAMP + time), trajectory.evaluate(time)
    for a, b in zip(played, wanted, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_ramps_stay_on_the_trajectory_and_below_its_speed(
    ramped: RampedExcitation, trajectory: FourierTrajectory
) -> None:
    period = trajectory.evaluate(np.linspace(0.0, trajectory.period, 20001))
    ramp = ramped.evaluate(np.linspace(0.0, RAMP, 101))
    for posture in ramp.q:
        assert np.abs(period.q - posture).max(axis=1).min() < 2e-3
    assert (np.abs(ramp.dq).max(axis=0) <= np.abs(period.dq).max(axis=0) + 1e-9).all()


@pytest.mark.parametrize(('periods', 'ramp'), [(0, 1.0), (1.5, 1.0), (1, 0.0)])
def test_only_whole_periods_and_positive_ramps(
    trajectory: FourierTrajectory, periods: float, ramp: float
) -> None:
    with pytest.raises(ExcitationError, match='period|ramp'):
        RampedExcitation(trajectory, periods, ramp)
