"""Contact on drone or arm is detected while the arm swings, in the physics engine."""

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest
from flown_arm import HANGING, ROBOT, Flight

from aerarm_ros.control.base.rotor_wrench import RotorWrench, carrier_parameters
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.contact_estimator import (
    DURATION,
    ContactEstimator,
    ContactObserver,
    ContactZero,
)
from aerarm_ros.flight.flight_state import OdometrySample
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics

DRONE = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
TOOL = Kinematics(ROBOT)
SWING, W = np.array([0.8, 0.5, 0.8, 0.7]), 2.0 * np.pi * np.array([0.5, 0.6, 0.75, 0.9])
BANDWIDTH = 4.0  # [Hz]
START = 100.0  # [s] of the clock
STEP = 0.004


def swing(time: float) -> tuple[np.ndarray, np.ndarray]:
    return HANGING + SWING * np.sin(W * time), SWING * W * np.cos(W * time)


def estimator_of(drone: DroneConfig) -> ContactEstimator:
    whole = WholeBodyDynamics(ROBOT, carrier=carrier_parameters(drone))
    return ContactEstimator(drone, ContactObserver(drone, whole, BANDWIDTH), RotorWrench(drone))


class TouchedFlight(Flight):
    """A drone that swings its arm, and its contact estimate."""

    def __init__(self, believed: DroneConfig = DRONE) -> None:
        super().__init__(DRONE)
        self.plant.reset(HANGING, SWING * W)
        self.plant.let_go()
        self.estimator = estimator_of(believed)
        # It has flown for long.
        self.plant.rotors.thrust[:] = self.control.update(self.state, self.target, 0.0)

    @property
    def clock(self) -> float:
        return START + self.time

    @property
    def base(self) -> np.ndarray:
        """Return the attitude of the arm's base."""
        return self.state.rotation @ DRONE.mount.rotation

    def tell(self) -> tuple[float, np.ndarray] | None:
        self.estimator.offer_joints(self.clock, self.plant.position, self.plant.velocity)
        self.estimator.offer_odometry(OdometrySample(self.clock, *self.plant.odometry))
        return self.estimator.update()

    def go(self, seconds: float) -> Iterator[np.ndarray]:
        """Continue the flight, and yield the published contact."""
        for _ in range(round(seconds / STEP)):
            told = self.tell()
            if told is not None:
                assert told[0] == self.clock
                yield told[1]
            self.fly()

    def fly(self) -> None:
        stamp = self.clock
        self.step(swing)
        self.estimator.offer_rotors(DRONE.rotor_names, self.thrust, stamp)


def test_known_forces_are_found_while_the_arm_moves() -> None:
    flight = TouchedFlight()
    untouched = list(flight.go(0.2))
    assert np.abs(untouched).max() < 0.1
    for link, force in (
        ('tool0', np.array([0.0, 2.0, 0.0])),
        ('', np.array([0.0, 0.0, -5.0])),
        ('tool0', np.array([-8.0, 0.0, 6.0])),
    ):
        flight.plant.touch(force, link)
        for _ in flight.go(0.25):
            pass
        for wrench in flight.go(0.08):
            in_base = force @ flight.base
            np.testing.assert_allclose(wrench[:3], in_base, atol=0.02 * np.linalg.norm(force))
            # Where it acts: at the tool, or at the drone's origin.
            body = DRONE.mount.rotation.T @ -np.array(DRONE.mount.position)
            place = TOOL.position(flight.plant.position) if link else body
            # The low-pass is late for what turns with the arm.
            moment = np.cross(place, in_base)
            np.testing.assert_allclose(wrench[3:], moment, atol=0.1 * np.linalg.norm(force))


def test_the_wrench_rises_as_a_first_order_low_pass() -> None:
    flight = TouchedFlight()
    list(flight.go(0.1))
    flight.plant.touch([0.0, 5.0, 0.0])
    rise = [wrench[:3] @ flight.base.T[:, 1] for wrench in flight.go(0.2)]
    times = STEP * np.arange(len(rise))
    expected = 5.0 * (1.0 - np.exp(-2.0 * np.pi * BANDWIDTH * times))
    np.testing.assert_allclose(rise, expected, atol=0.05)


def test_the_wrench_fades_without_input_and_restarts_when_the_input_returns() -> None:
    flight = TouchedFlight()
    flight.plant.touch([5.0, 0.0, 0.0])
    *_, wrench = flight.go(0.2)
    size = np.linalg.norm(wrench)
    sizes = []
    for _ in range(85):  # a third of a second without odometry
        flight.estimator.offer_joints(flight.clock, flight.plant.position, flight.plant.velocity)
        if (told := flight.estimator.update()) is not None:
            sizes.append(np.linalg.norm(told[1]))
        flight.fly()
    assert 'no good odometry for 0.3' in flight.estimator.problem()
    assert len(sizes) > 10
    np.testing.assert_allclose(np.diff([size, *sizes]), -size / 20, rtol=1e-6)
    assert sizes[-1] == 0.0
    first, *_ = flight.go(0.05)
    assert np.linalg.norm(first) == 0.0
    assert flight.estimator.problem() == ''
    # No joint states any more: told from outside.
    assert flight.estimator.fade(0.01) is not None


def test_odometry_that_was_lost_in_between_does_no_harm() -> None:
    flight = TouchedFlight()
    told = []
    for lost in range(8):
        told += flight.go(0.04)
        for _ in range(lost % 4):
            flight.fly()
    assert np.abs(told).max() < 0.15


def odometry(stamp: float, height: float = 0.0) -> OdometrySample:
    place = np.array([0.0, 0.0, height])
    return OdometrySample(stamp, place, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3))


def test_invalid_samples_are_rejected_and_all_inputs_are_needed() -> None:
    estimator, hover = estimator_of(DRONE), np.full(6, 7.0)
    assert estimator.problem() == 'no joint states yet'
    assert estimator.update() is None
    estimator.offer_joints(START, HANGING, np.zeros(4))
    assert estimator.problem() == 'no odometry yet'
    refused: list[tuple[Callable[[], None], str]] = [
        (lambda: estimator.offer_odometry(odometry(0.0)), r'stamp is -100 s .*synchronise'),
        (lambda: estimator.offer_rotors(['a'], np.ones(1), START), 'rotors'),
        (lambda: estimator.offer_rotors(DRONE.rotor_names, np.nan * hover, START), 'NaN'),
        (lambda: estimator.offer_rotors(DRONE.rotor_names, hover, 0.0), "the drone's clock"),
    ]
    for action, reason in refused:
        with pytest.raises(RejectedInputError, match=reason):
            action()
    estimator.offer_odometry(odometry(START))
    assert estimator.problem() == 'no rotor commands yet'
    assert estimator.update() is None
    assert estimator.fade(0.01) is None
    estimator.offer_rotors(DRONE.rotor_names, hover, START)
    assert estimator.problem() == ''
    estimator.offer_odometry(odometry(START))  # told again
    with pytest.raises(RejectedInputError, match='position jumps'):
        estimator.offer_odometry(odometry(START + STEP, 3.0))
    with pytest.raises(ValueError, match='contact_bandwidth'):
        ContactObserver(DRONE, WholeBodyDynamics(ROBOT), 0.0)


PLACE = np.array([0.02, -0.01, -0.06])  # of 0.3 kg that nobody knows of, in base axes
UPSIDE_DOWN = pin.rpy.rpyToMatrix(np.pi, 0.0, 0.0)


def felt(force: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    in_base = force @ rotation
    return np.concatenate([in_base, np.cross(PLACE, in_base)])


def test_an_unknown_weight_is_subtracted_once_it_is_averaged() -> None:
    zero, weight = ContactZero(), np.array([0.0, 0.0, -2.9])
    wrench = felt(weight, UPSIDE_DOWN)
    np.testing.assert_allclose(zero.apply(wrench, UPSIDE_DOWN, STEP), wrench)
    zero.begin()
    random = np.random.default_rng(1)
    for _ in range(int(DURATION / STEP) - 1):
        noisy = wrench + random.normal(scale=0.05, size=6)
        np.testing.assert_allclose(zero.apply(noisy, UPSIDE_DOWN, STEP), noisy)
    for _ in range(3):
        left = zero.apply(wrench, UPSIDE_DOWN, STEP)
    np.testing.assert_allclose(left, 0.0, atol=0.01)
    # It turns and leans, and is pushed.
    turned = pin.rpy.rpyToMatrix(0.1, -0.1, 1.0) @ UPSIDE_DOWN
    push = np.array([1.0, 2.0, -0.5])
    left = zero.apply(felt(weight + push, turned), turned, STEP)
    np.testing.assert_allclose(turned @ left[:3], push, atol=0.01)
    # Begun anew, it forgets what it was.
    zero.begin()
    for _ in range(int(DURATION / STEP) + 2):
        left = zero.apply(np.zeros(6), UPSIDE_DOWN, STEP)
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
