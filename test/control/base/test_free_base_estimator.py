"""The arm under drones that it moves, in the physics engine, with failures of every source."""

import tracemalloc
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

from aerarm_ros.control.base.base_motion import ImuSample
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
SETTLED, LENGTH = 2.5, 4.0  # [s]


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


def test_status_names_the_sources_in_use() -> None:
    hover = Hover()
    assert hover.status.startswith('neither') and 'no IMU yet' in hover.status
    hover.run(2.0)
    assert hover.status == 'rotor commands + IMU below 0.3 Hz'
    assert hover.estimator.problem(hover.now) == ''
    hover.run(0.5, thrust=nothing)
    assert 'Hz: no good rotor command for 0.5' in hover.status
    assert hover.estimator.problem(hover.now) == hover.status
    hover.run(0.5, imu=nothing)
    assert 'assumed to hover: no good IMU sample for 0.5' in hover.status


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


def test_commands_that_come_back_otherwise_act_through_the_rotors_lag() -> None:
    """The gap is too short for the control law to drop the rotors."""
    steps = []
    for gap in (0.0, 0.2):
        hover = Hover()
        hover.run(2.0)
        hover.run(gap, thrust=nothing)
        hover.run(0.1, thrust=lambda t, hover=hover: (1.2 + 1e-3 * np.sin(t)) * hover.thrust)
        assert hover.status == 'rotor commands + IMU below 0.3 Hz'
        steps.append(hover.largest_step())
    assert steps[1] < 1.01 * steps[0]


def test_imu_samples_take_no_memory_while_the_arm_is_not_controlled() -> None:
    hover = Hover()
    hover.run(2.0)
    tracemalloc.start()
    for _ in range(500):
        hover.now += 0.004
        hover.estimator.offer(hover.sample(1e-3 * hover.random.normal(size=10)), hover.now)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 10_000
    hover.run(1.0)
    assert hover.status == 'rotor commands + IMU below 0.3 Hz'


@pytest.mark.parametrize(
    ('rate', 'push', 'said'),
    [
        (20.0, 0.0, 'no good IMU sample'),
        (3.5, 0.0, 'no good IMU sample'),
        (0.0, 8.0, 'from that predicted by rotor commands, mass and arm'),
    ],
)
def test_an_imu_that_jumps_and_stays_there_is_named_and_moves_no_torque(
    rate: float, push: float, said: str
) -> None:
    hover = Hover()
    hover.run(2.5)

    def jumped(now: float) -> ImuSample:
        shake = 1e-3 * hover.random.normal(size=(2, 3))
        turns, feels = np.array([rate, 0.0, 0.0]), UP + [0.0, 0.0, push]
        return ImuSample(now, LEVEL, turns + shake[0], feels + shake[1])

    hover.run(2.0, imu=jumped)
    assert said in hover.status
    np.testing.assert_allclose(hover.torques[-1], hover.dynamics.gravity(LEANING), atol=0.05)
    hover.run(3.0)
    assert hover.status == 'rotor commands + IMU below 0.3 Hz'
    assert hover.largest_step() < 0.02 * np.abs(hover.torques[-1]).max()


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


@pytest.mark.parametrize(
    ('names', 'thrust', 'reason'),
    [
        (
            ('front', 'left', 'rear', 'right'),
            np.ones(4),
            ('check that drone_file describes this drone'),
        ),
        (None, np.ones(3), '3 efforts for 4 rotors'),
        (None, np.array([1.0, np.nan, 1.0, 1.0]), 'NaN or infinite'),
        (None, np.full(4, 1500.0), 'far above thrust_max'),
    ],
)
def test_wrong_commands_are_refused(names, thrust, reason: str) -> None:
    estimator = Hover().estimator
    with pytest.raises(RejectedInputError, match=reason):
        estimator.rotors.offer(names or estimator.rotors._drone.rotor_names, thrust, 0.0, 0.0)


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
