"""Stability of loops through the drone: oscillations are found."""

from typing import Any

import numpy as np
import pytest
from hovering_drone import CHEAP, CONFIG, CYCLE, ROTORS, FlightFaults, drone_of, fly, make_estimator
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.base.feedback_check import OscillationWatch
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.simulation.base_profile import BASE_PROFILES, BaseProfile

GRAVITY = np.array([0.0, 0.0, -9.81])
EFFORT = CONFIG.column('effort_max')
POSTURE = np.array([0.0, np.pi / 2, 0.3, 0.3])


class WatchedFlight:
    """A flight with `base_motion: full` and without a drone file."""

    def __init__(self, mass: float, kind: str, seconds: float, faults=None, make_law=None) -> None:
        self.bases: list[Any] = []
        self.errors = np.abs(
            fly(drone_of(mass), kind, 'full', seconds, faults, make_law, None, self._make)
        ).max(axis=1)
        self.problem = self.bases[0].problem(seconds)

    def _make(self, *given: Any) -> Any:
        self.bases.append(make_estimator(*given))
        return self.bases[-1]


def soft(dynamics: MovingBaseDynamics) -> GravityCompensation:
    return GravityCompensation(dynamics, [60, 60, 30, 30], [3, 3, 1.5, 1.5])


@pytest.mark.parametrize(
    ('mass', 'kind', 'faults', 'make_law'),
    [
        (3.0, 'slow', None, None),
        (1.3, 'fast', None, None),
        (1.3, 'slow', FlightFaults(noise=CHEAP), soft),
        (3.0, 'slow', FlightFaults(noise=CHEAP, latency=0.010), None),
    ],
    ids=['3 kg', '1.3 kg', '1.3 kg, gravity compensation', '3 kg, cheap IMU 10 ms late'],
)
def test_a_light_drone_is_found_before_the_arm_is_far_off(mass, kind, faults, make_law) -> None:
    flight = WatchedFlight(mass, kind, 1.0, faults, make_law)
    assert 'the torque of joint 2' in flight.problem
    assert 'set drone_file' in flight.problem
    # Unwatched it is 45, 75, 100 and 170 mrad within 1 s.
    assert flight.errors.max() < 0.03
    assert flight.errors[-200:].max() < 0.01


def test_a_heavy_drone_with_a_cheap_imu_is_left_alone_even_if_its_arm_picks_something_up() -> None:
    flight = WatchedFlight(20.0, 'fast', 1.2, FlightFaults(noise=CHEAP, latency=0.010, load=0.5))
    assert flight.problem == ''


@pytest.mark.parametrize(
    ('profile', 'pace'), [('tilted', 0.6), ('moving', 0.6), ('moving', 3.0), ('still', 3.0)]
)
def test_driven_bases_and_quick_arms_are_left_alone(robot: Robot, profile: str, pace: float):
    """The arm swings with `pace` [Hz] as commanded; a cheap IMU."""
    bed = DrivenBase(robot, BASE_PROFILES[profile], pace)
    torques = np.array([bed.cycle() for _ in range(3000)])
    assert np.ptp(torques, axis=0).max() > (2.0 if pace < 1.0 and profile == 'tilted' else 8.0)
    assert bed.estimator.problem(bed.now) == ''


class DrivenBase:
    """An arm with prescribed motion on a base with prescribed motion, torques by the law."""

    def __init__(self, robot: Robot, profile: BaseProfile, pace: float) -> None:
        self.dynamics = MovingBaseDynamics(robot, ROTORS)
        watch = OscillationWatch(EFFORT)
        self.estimator = BaseMotionEstimator(GRAVITY, 'full', watch=watch)
        self.random = np.random.default_rng(0)
        self.profile, self.rate, self.now = profile, 2.0 * np.pi * pace, 0.0
        self.amplitude = min(0.5, 50.0 / self.rate**2)

    def cycle(self) -> np.ndarray:
        if round(self.now / CYCLE) % 4 == 0:
            self.estimator.offer(self.sample(), self.now)
        wave = self.amplitude * np.array([1.0, self.rate, -(self.rate**2)])
        s, c = np.sin(self.rate * self.now), np.cos(self.rate * self.now)
        q, dq, ddq = POSTURE + wave[0] * s, np.full(4, wave[1] * c), np.full(4, wave[2] * s)
        base = self.estimator.motion(self.now, 1.5 * CYCLE)
        tau = np.clip(self.dynamics.inverse(q, dq, ddq, base), -EFFORT, EFFORT)
        self.now += CYCLE
        self.estimator.observe(ArmState(q, dq, tau), self.now)
        return tau

    def sample(self) -> ImuSample:
        base, noise = self.profile.evaluate(self.now), self.random.normal(size=6)
        turn = Rotation.from_quat(np.roll(base.quaternion, -1))
        force = turn.inv().apply(base.acceleration - GRAVITY) + CHEAP['force'] * noise[:3]
        rate = base.angular_velocity + CHEAP['rate'] * noise[3:]
        return ImuSample(self.now, turn.as_quat(), rate, force)


class Shaken:
    """An IMU and a torque that oscillate together, on a drone that tilts and accelerates."""

    lean = Rotation.from_euler('x', 0.2)
    force = np.array([2.0, 0.0, 9.81])

    def __init__(self, attitude: bool = True) -> None:
        self.estimator = BaseMotionEstimator(GRAVITY, 'full', watch=OscillationWatch(EFFORT))
        self.attitude = self.lean.as_quat() if attitude else None
        self.now = 0.0

    def run(self, seconds: float, frequency: float, lag: float = 0.0, torque: float = 6.0) -> Any:
        """Continue; the IMU's motion follows the torque by `lag` [rad]."""
        motions = []
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            phase = 2.0 * np.pi * frequency * self.now
            if round(self.now / CYCLE) % 4 == 1:  # the first one too
                force = self.force + [3.0 * np.sin(phase - lag), 0.0, 0.0]
                sample = ImuSample(self.now, self.attitude, np.zeros(3), force)
                self.estimator.offer(sample, self.now)
            motions.append(np.concatenate(self.estimator.motion(self.now)))
            tau = np.array([0.0, torque * np.sin(phase), np.nan, 0.0])
            self.estimator.observe(ArmState(POSTURE, np.zeros(4), tau), self.now)
        return np.array(motions)

    @property
    def problem(self) -> str:
        return self.estimator.problem(self.now)


@pytest.mark.parametrize('frequency', [15.0, 30.0, 60.0, 110.0])
@pytest.mark.parametrize('lag', [0.0, 1.6, 3.1])
def test_any_lag_is_found_at_any_frequency_of_such_a_loop(frequency: float, lag: float) -> None:
    shaken = Shaken()
    shaken.run(0.5, frequency, lag)
    assert 'of joint 2' in shaken.problem


def test_a_small_or_slow_oscillation_of_the_base_is_not_reported() -> None:
    for frequency, torque in ((30.0, 1.5), (1.5, 6.0)):
        shaken = Shaken()
        shaken.run(2.0, frequency, 0.0, torque)
        assert shaken.problem == ''


@pytest.mark.parametrize('attitude', [True, False])
def test_after_an_oscillation_the_controller_changes_to_attitude_without_a_step(
    attitude: bool,
) -> None:
    shaken = Shaken(attitude)
    before = [*shaken.run(0.05, 25.0)]
    while not shaken.problem:
        before += [*shaken.run(CYCLE, 25.0)]
        assert shaken.now < 1.0
    after = shaken.run(0.5, 25.0)
    shaking = np.abs(np.diff(before, axis=0)).max()
    # The whole difference, oscillation included, goes within 0.1 s.
    fading = 0.01 * np.abs(before[-200:] - after[-1]).max()
    assert np.abs(np.diff([before[-1], *after], axis=0)).max() < shaking + fading
    assert fading < 0.05 * shaking
    gravity = shaken.lean.inv().apply(GRAVITY) if attitude else GRAVITY
    level = np.concatenate([gravity, -gravity, np.zeros(6)])
    np.testing.assert_allclose(after[110:], np.tile(level, (390, 1)), atol=1e-9)
    assert 'only its attitude until restart' in shaken.problem
    # Silence is what it always was.
    assert 'no IMU sample for' in shaken.estimator.problem(shaken.now + 1.0)
    np.testing.assert_allclose(shaken.estimator.motion(shaken.now + 1.0).gravity, GRAVITY)
