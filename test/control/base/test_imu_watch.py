"""Plausible changes between consecutive IMU samples."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.base.free_base_estimator import ImuWatch
from aerarm_ros.control.checks import RejectedInputError

UP = np.array([0.0, 0.0, 9.81])
ANGLES, RATES = np.array([0.2, 0.15, 0.4]), np.array([4.0, 5.0, 3.0])  # [rad], [rad/s]
PERIOD = 0.004  # [s]


class TurningImu:
    """An IMU that rotates to and fro at up to 1.2 rad/s, with a cheap sensor's noise."""

    def __init__(self) -> None:
        self.watch, self.random, self.now = ImuWatch(), np.random.default_rng(0), 0.0

    def sample(self, rate=0.0, force=0.0, turn: Rotation | None = None) -> ImuSample:
        self.now += PERIOD
        attitude, after = (self._attitude(self.now + x) for x in (0.0, 1e-5))
        true_rate = (attitude.inv() * after).as_rotvec() / 1e-5
        noise = self.random.normal(size=(2, 3))
        if turn is not None:
            attitude = turn * attitude
        return ImuSample(
            self.now,
            attitude.as_quat(),
            true_rate + rate + 0.01 * noise[0],
            UP + force + 0.3 * noise[1],
        )

    def run(self, seconds: float, make: Callable[[], ImuSample] | None = None) -> list[str]:
        """Return the reasons of rejections, '' for an accepted sample."""
        reasons = []
        for _ in range(round(seconds / PERIOD)):
            try:
                self.watch.check((make or self.sample)())
                reasons.append('')
            except RejectedInputError as error:
                reasons.append(str(error))
        return reasons

    def _attitude(self, now: float) -> Rotation:
        return Rotation.from_euler('xyz', ANGLES * np.sin(RATES * now))


def test_a_flight_with_a_cheap_sensor_is_taken() -> None:
    flight = TurningImu()
    assert set(flight.run(4.0)) == {''}
    # The filter of the attitude is reset by a compass: the same flight, seen from another world.
    north = Rotation.from_rotvec([0.0, 0.0, 1.2])
    assert set(flight.run(2.0, lambda: flight.sample(turn=north))) == {''}


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'rate': 20.0}, 'angular velocity jumps'),
        ({'rate': 2.5}, 'angular velocity jumps'),
        ({'force': np.array([0.0, 30.0, 0.0])}, 'acceleration jumps'),
        ({'force': 7.0 * UP}, 'more than the rotors can cause'),
    ],
)
def test_a_jump_that_stays_is_refused_until_it_is_forgotten(change: dict, said: str) -> None:
    flight = TurningImu()
    flight.run(1.0)
    reasons = flight.run(1.0, lambda: flight.sample(**change))
    assert said in reasons[0]
    assert '' not in reasons
    flight.watch.forget()
    # What the attitude said of the gyroscope takes its time.
    assert set(flight.run(1.5)[-100:]) == {''}


def test_after_a_reset_another_acceleration_is_accepted_but_no_other_rotation() -> None:
    flight = TurningImu()
    flight.run(1.0)
    push = np.array([0.0, 30.0, 0.0])
    assert '' not in flight.run(0.1, lambda: flight.sample(force=push))
    flight.watch.forget()
    assert set(flight.run(0.1, lambda: flight.sample(force=push))) == {''}
    flight.run(0.4, lambda: flight.sample(rate=2.5))
    flight.watch.forget()
    reasons = flight.run(0.2, lambda: flight.sample(rate=2.5))
    assert all('angular velocity and attitude differ' in reason for reason in reasons)


def test_a_gyroscope_in_other_axes_than_the_attitude_is_named() -> None:
    flight = TurningImu()

    def swapped() -> ImuSample:
        sample = flight.sample()
        rate = sample.angular_velocity[[1, 0, 2]] * (1.0, 1.0, -1.0)
        return ImuSample(sample.stamp, sample.attitude, rate, sample.specific_force)

    reasons = flight.run(3.0, swapped)
    assert any('both have the same axes' in reason for reason in reasons)


def test_a_clock_set_back_is_no_fault() -> None:
    flight = TurningImu()
    flight.run(1.5)
    sample = flight.sample()
    back = ImuSample(0.0, sample.attitude, sample.angular_velocity, sample.specific_force)
    flight.watch.check(back)


@pytest.mark.parametrize(
    ('frozen', 'said'),
    [
        (('specific_force', 'angular_velocity'), 'frozen'),
        (('specific_force',), 'its acceleration is frozen'),
        (('angular_velocity',), 'its angular velocity is frozen'),
    ],
)
def test_the_same_numbers_for_a_tenth_of_a_second_are_frozen(
    frozen: tuple[str, ...], said: str
) -> None:
    """One frozen sensor of the two is enough."""
    flight = TurningImu()
    flight.run(0.1)
    last = flight.sample()

    def again() -> ImuSample:
        return replace(
            flight.sample(), attitude=None, **{key: getattr(last, key) for key in frozen}
        )

    reasons = flight.run(0.2, again)
    assert '' in reasons[:20] and said in reasons[-1]
    assert flight.run(0.1)[-1] == ''


def test_an_imu_without_noise_on_a_standing_drone_is_not_frozen() -> None:
    """An emulated drone stands on its support until the arm is enabled."""
    flight = TurningImu()

    def standing(force: np.ndarray) -> ImuSample:
        flight.now += PERIOD
        return ImuSample(flight.now, None, np.zeros(3), force)

    assert set(flight.run(0.5, lambda: standing(UP))) == {''}
    noise = iter(flight.random.normal(size=(200, 3)))
    assert 'angular velocity is frozen' in flight.run(0.5, lambda: standing(UP + next(noise)))[-1]
