"""The arm under drones that it moves, in the physics engine, with failures of every source."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hovering_drone import (
    CHEAP,
    LINK_DELAY,
    ROTORS,
    FlightFaults,
    drone_of,
    fly,
    make_estimator,
    rms,
)
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.base.free_base_estimator import AnswerCorrection, ImuWatch
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.base.rotor_wrench import carrier_parameters
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.compensation import MomentumObserver
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.description.robot import load_robot
from aerarm_ros.motion.signals import ArmState

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
UP = np.array([0.0, 0.0, 9.81])
LEANING = np.array([0.0, 0.8, 0.0, 0.5])
SETTLED, LENGTH = 2.0, 3.5  # [s]; the swing has grown by then


@pytest.fixture(scope='module')
def fast_on_a_fixed_base() -> float:
    return rms(fly(drone_of(1.3), 'fast', 'fixed', LENGTH), SETTLED)


def test_fast_motion_is_as_exact_as_on_a_fixed_base(fast_on_a_fixed_base: float) -> None:
    free = rms(fly(drone_of(1.3), 'fast', 'free', LENGTH), SETTLED)
    assert free < 1.1 * fast_on_a_fixed_base


def test_nothing_wrong_at_once_makes_it_worse_than_ignoring_the_base() -> None:
    """A drone file with 20 % error, a cheap IMU with 10 ms delay, and missing rotor commands."""
    drone = drone_of(1.3)
    ignored = rms(fly(drone, 'fast', 'none', LENGTH), SETTLED)
    heavy = FlightFaults(drone.with_errors(1.2, 0.8), CHEAP, 0.010)
    assert rms(fly(drone, 'fast', 'free', LENGTH, heavy), SETTLED) < 0.5 * ignored
    alone = replace(heavy, commands=False)
    assert rms(fly(drone, 'fast', 'free', LENGTH, alone), SETTLED) < 1.02 * ignored


def test_compensation_of_a_payload_on_a_free_base_does_not_include_base_motion() -> None:
    """The model has a wrong payload of 0.3 kg, which the observer detects under any drone."""

    def law(dynamics: MovingBaseDynamics) -> GravityCompensation:
        dynamics.carry([0.3, 0.03, 0.0, 0.0, 1e-3, 0.0, 4e-3, 0.0, 0.0, 4e-3])
        return GravityCompensation(dynamics, [60, 60, 30, 30], [3, 3, 1.5, 1.5])

    def observer(dynamics: MovingBaseDynamics) -> MomentumObserver:
        return MomentumObserver(dynamics, 30.0)

    alone = rms(fly(drone_of(1.3), 'slow', 'free', 3.5, None, law), 2.0)
    observed = rms(fly(drone_of(1.3), 'slow', 'free', 3.5, None, law, observer), 2.0)
    assert observed < 0.6 * alone


class Hover:
    """A drone that hovers as in its estimator's model, with joints at rest."""

    def __init__(self, mass: float = 1.3) -> None:
        self.drone = drone_of(mass)
        self.robot = load_robot(gravity_in_base=self.drone.gravity_in_base)
        self.estimator = make_estimator('free', self.drone, self.robot)
        carrier = carrier_parameters(self.drone)
        self.dynamics = MovingBaseDynamics(self.robot, ROTORS, carrier)
        weight = 9.81 * self.estimator.whole.mass
        _, com, _ = self.estimator.whole.composite_inertia(LEANING)
        force = self.drone.mount.rotation.T @ [0.0, 0.0, weight]
        wrench = np.concatenate([force, np.cross(com, force)])
        self.thrust = np.linalg.pinv(self.estimator.rotors.matrix) @ wrench
        self.random = np.random.default_rng(0)
        self.now = 0.0
        self.torques: list[np.ndarray] = []

    def run(self, seconds: float, imu=None, thrust=None, names=None) -> None:
        """Continue; `imu` and `thrust` are functions of time that return None to send nothing."""
        names = names or self.drone.rotor_names
        for _ in range(round(seconds / 0.004)):
            self.now += 0.004
            shake = 1e-3 * self.random.normal(size=10)
            sample = self.sample(shake) if imu is None else imu(self.now)
            command = (
                self.thrust + shake[: len(self.thrust)] if thrust is None else thrust(self.now)
            )
            try:
                if sample is not None:
                    self.estimator.offer(sample, self.now)
                if command is not None:
                    self.estimator.rotors.offer(names, command, self.now, self.now)
            except RejectedInputError:
                pass
            self.estimator.observe(ArmState(LEANING, np.zeros(4), np.zeros(4)), self.now)
            base = self.estimator.motion(self.now)
            self.torques.append(self.dynamics.inverse(LEANING, np.zeros(4), np.zeros(4), base))

    def sample(self, shake: np.ndarray) -> ImuSample:
        return ImuSample(self.now, LEVEL, shake[:3], UP + shake[3:6])

    @property
    def status(self) -> str:
        return self.estimator.status(self.now)

    def largest_step(self) -> float:
        """Largest change of a torque within 4 ms [Nm]."""
        return float(np.abs(np.diff(self.torques, axis=0)).max())


def nothing(_: float) -> None:
    return None


def jumped(rate: float, push: float) -> Callable[[float], ImuSample]:
    """Return an IMU that jumps to a rate [rad/s] or an acceleration [m/s^2] and stays there."""

    def sample(now: float) -> ImuSample:
        shake = 1e-3 * np.sin(1e3 * now + np.arange(6.0))
        turns, feels = np.array([rate, 0.0, 0.0]), UP + [0.0, 0.0, push]
        return ImuSample(now, LEVEL, turns + shake[:3], feels + shake[3:])

    return sample


@pytest.mark.parametrize(
    ('fault', 'said'),
    [
        ({'imu': nothing}, 'no good IMU sample'),
        ({'thrust': nothing}, 'no good rotor command'),
        ({'imu': nothing, 'thrust': nothing}, 'no good IMU sample'),
        ({'thrust': lambda _: np.full(4, np.nan)}, 'no good rotor command'),
        ({'thrust': lambda _: np.full(4, 1500.0)}, 'no good rotor command'),
        ({'names': ('a', 'b', 'c', 'd')}, 'no good rotor command'),
        ({'imu': lambda t: ImuSample(t, LEVEL, np.zeros(3), UP)}, 'no good IMU sample'),
        ({'imu': lambda t: ImuSample(t, LEVEL, np.zeros(3), 6.0 * UP)}, 'no good IMU sample'),
        ({'imu': jumped(20.0, 0.0)}, 'no good IMU sample'),
        ({'imu': jumped(3.5, 0.0)}, 'no good IMU sample'),
        ({'imu': jumped(0.0, 8.0)}, 'from that predicted by rotor commands, mass and arm'),
    ],
)  # fmt: skip
def test_a_source_that_fails_is_named_and_fades_without_a_step(fault: dict, said: str) -> None:
    hover = Hover()
    hover.run(3.0)
    before = hover.torques[-1]
    hover.run(2.0, **fault)
    assert said in hover.status
    # It ends at what holds the arm under a level drone.
    np.testing.assert_allclose(hover.torques[-1], hover.dynamics.gravity(LEANING), atol=0.05)
    hover.run(3.0)
    assert hover.status == 'rotor commands + IMU below 0.3 Hz'
    np.testing.assert_allclose(hover.torques[-1], before, atol=0.05)
    assert hover.largest_step() < 0.01 * np.abs(before).max()


def test_commands_that_repeat_or_do_not_lift_the_drone_are_not_used() -> None:
    hover = Hover()
    hover.run(3.0)
    hover.run(2.0, thrust=lambda _: hover.thrust)
    assert 'rotor commands unchanged' in hover.status
    assert hover.largest_step() < 0.01 * np.abs(hover.torques[-1]).max()
    hover.run(2.0, thrust=lambda t: np.full(4, 0.5 + 1e-3 * np.sin(t)))
    assert 'not in flight' in hover.status
    np.testing.assert_allclose(hover.torques[-1], hover.dynamics.gravity(LEANING), atol=0.05)


def test_the_imu_corrects_too_large_a_mass_in_the_drone_file() -> None:
    hover = Hover()
    heavy = hover.drone.with_errors(1.2, 1.2)
    hover.estimator = make_estimator('free', heavy, hover.robot)
    hover.dynamics = MovingBaseDynamics(hover.robot, ROTORS, carrier_parameters(heavy))
    hover.run(5.0)
    wanted = hover.dynamics.gravity(LEANING)
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(hover.torques[-1], wanted, atol=0.01)


def test_commands_are_taken_by_name_and_in_order() -> None:
    hover = Hover()
    rotors, names = hover.estimator.rotors, hover.drone.rotor_names
    rotors.offer(names[::-1], np.arange(4.0), 1.0, 1.0)
    np.testing.assert_allclose(rotors.thrust(1.0 + LINK_DELAY), np.arange(4.0)[::-1])
    with pytest.raises(RejectedInputError, match='older'):
        rotors.offer(names, np.arange(4.0), 0.999, 1.001)
    # An answer to the same odometry, told again: that is no sign of life.
    for moment in np.arange(1.0, 1.2, 0.01):
        rotors.offer(names[::-1], np.arange(4.0), 1.0, moment)
    assert 'no good rotor command' in rotors.problem(1.2)
    rotors.offer(names, np.arange(4.0), 1.0, 1.2)
    assert rotors.problem(1.2) == ''
    for others, thrust, reason in (
        (('front', 'left', 'rear', 'right'), np.ones(4), 'drone_file describes this drone'),
        (names, np.ones(3), '3 efforts for 4 rotors'),
        (names, np.array([1.0, np.nan, 1.0, 1.0]), 'NaN or infinite'),
        (names, np.full(4, 1500.0), 'far above thrust_max'),
    ):
        with pytest.raises(RejectedInputError, match=reason):
            rotors.offer(others, thrust, 2.0, 2.0)


IMU_PERIOD = 0.004
FORCE_NOISE, RATE_NOISE = 0.3, 0.01  # of a cheap IMU [m/s^2], [rad/s]


def trust(predicted: float, measured: float, noise: float, frequency: float = 0.35) -> np.ndarray:
    """Return the trust after 20 s of swings of given sizes [m/s^2], [rad/s^2], with a noisy IMU."""
    random = np.random.default_rng(0)
    correction, last = AnswerCorrection(), np.zeros(3)
    for now in np.arange(0.0, 20.0, IMU_PERIOD):
        swing = np.full(6, np.sin(2.0 * np.pi * frequency * now))
        force, rate = noise * random.standard_normal((2, 3))
        # Angular acceleration is the difference of two rates.
        shake = np.concatenate([FORCE_NOISE * force, RATE_NOISE * (rate - last) / IMU_PERIOD])
        last = rate
        correction.update(predicted * swing, measured * swing + shake, IMU_PERIOD)
    return correction.trust


@pytest.mark.parametrize(
    ('predicted', 'measured', 'noise', 'least', 'most'),
    [
        # Too small a mass in the drone file, a heavy drone, slow motion: the model is wrong.
        (0.24, 0.02, 0.0, 0.0, 0.35),
        (0.24, 0.02, 1.0, 0.0, 0.35),
        # Nothing to learn from, a correct prediction, too small a one, and a noisy IMU.
        (0.0, 0.0, 0.0, 0.94, 1.06),
        (0.24, 0.24, 0.0, 0.94, 1.06),
        (0.2, 0.24, 0.0, 1.14, 1.26),
        (2.0, 2.0, 1.0, 0.9, 1.1),
    ],
)
def test_a_prediction_has_the_weight_that_it_deserves(
    predicted: float, measured: float, noise: float, least: float, most: float
) -> None:
    found = trust(predicted, measured, noise)
    assert np.all((least <= found) & (found <= most))


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
    flight.watch.check(replace(flight.sample(), stamp=0.0))  # a clock that is set back


def swapped(flight: TurningImu) -> ImuSample:
    """Return a sample of a gyroscope in other axes than the attitude."""
    sample = flight.sample()
    rate = sample.angular_velocity[[1, 0, 2]] * (1.0, 1.0, -1.0)
    return replace(sample, angular_velocity=rate)


def changed(**change: object) -> Callable[[TurningImu], ImuSample]:
    return lambda flight: flight.sample(**change)


def frozen(*names: str) -> Callable[[TurningImu], ImuSample]:
    """Return a source of samples in which some values stay those of the first."""
    kept: dict[str, object] = {}

    def again(flight: TurningImu) -> ImuSample:
        sample = flight.sample()
        kept.update({name: getattr(sample, name) for name in names if name not in kept})
        return replace(sample, attitude=None, **kept)

    return again


@pytest.mark.parametrize(
    ('make', 'said', 'seconds'),
    [
        (changed(rate=20.0), 'angular velocity jumps', 0.0),
        (changed(rate=2.5), 'angular velocity jumps', 0.0),
        (changed(force=np.array([0.0, 30.0, 0.0])), 'acceleration jumps', 0.0),
        (changed(force=7.0 * UP), 'more than the rotors can cause', 0.0),
        (swapped, 'both have the same axes', 3.0),
        (frozen('specific_force', 'angular_velocity'), 'frozen', 0.2),
        (frozen('specific_force'), 'its acceleration is frozen', 0.2),
        (frozen('angular_velocity'), 'its angular velocity is frozen', 0.2),
    ],
)
def test_a_faulty_imu_is_refused_until_its_fault_is_over_and_forgotten(
    make: Callable[[TurningImu], ImuSample], said: str, seconds: float
) -> None:
    flight = TurningImu()
    flight.run(1.0)
    reasons = flight.run(seconds or 1.0, lambda: make(flight))
    assert any(said in reason for reason in reasons)
    if not seconds:  # a jump that stays
        assert said in reasons[0] and '' not in reasons
    flight.watch.forget()
    # What the attitude said of the gyroscope takes its time.
    assert set(flight.run(1.5)[-100:]) == {''}


def test_an_imu_without_noise_on_a_standing_drone_is_not_frozen() -> None:
    """An emulated drone stands on its support until the arm is enabled."""
    flight = TurningImu()

    def standing(force: np.ndarray) -> ImuSample:
        flight.now += PERIOD
        return ImuSample(flight.now, None, np.zeros(3), force)

    assert set(flight.run(0.5, lambda: standing(UP))) == {''}
    noise = iter(flight.random.normal(size=(200, 3)))
    assert 'angular velocity is frozen' in flight.run(0.5, lambda: standing(UP + next(noise)))[-1]
