"""Hovering in the physics engine, with the arm at rest and in motion, light and heavy."""

from dataclasses import replace

import numpy as np
import pytest
from flown_arm import HANGING, Flight

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward, ArmLoadModel
from aerarm_ros.flight.flight_control import Allocation, FlightControl, FlightGains
from aerarm_ros.flight.flight_state import FlightTarget, yaw_of
from aerarm_ros.motion.signals import JointReference

ARM = 1.487  # [kg]
# Amplitudes [rad] and frequencies [Hz].
FAST = np.array([0.5, 0.8, 0.6, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])


def scaled(mass: float) -> DroneConfig:
    """Return a hexarotor of another mass [kg], of the same shape and reserve."""
    drone = load_drone_config()
    size, thrust = mass / drone.mass, (mass + ARM) / (drone.mass + ARM)
    rotors = tuple(replace(rotor, thrust_max=thrust * rotor.thrust_max) for rotor in drone.rotors)
    inertia = tuple(size ** (5 / 3) * value for value in drone.inertia)
    return replace(drone, mass=mass, inertia=inertia, rotors=rotors)


def packaged(name: str) -> DroneConfig:
    return load_drone_config(resource('config', 'drones', f'{name}.yaml'))


DRONES = {
    '1.3 kg quadrotor': packaged('quadrotor'),
    '3 kg': load_drone_config(),
    '3 kg tilted': packaged('tilted_hexarotor'),
    '10 kg': scaled(10.0),
}


def fast_motion(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the arm's q and dq, from rest within 2 s."""
    (amplitude, frequency), s = FAST, min(1.0, time / 2.0)
    grown, w = s * s * (3.0 - 2.0 * s), 2.0 * np.pi * frequency
    return HANGING + grown * amplitude * np.sin(w * time), grown * amplitude * w * np.cos(w * time)


@pytest.mark.parametrize('name', ['1.3 kg quadrotor', '3 kg tilted', '10 kg'])
def test_the_drone_keeps_flying_while_the_arm_swings_fast(name: str) -> None:
    flight = Flight(DRONES[name])
    farthest, steepest = 0.0, 0.0
    while flight.time < 4.0:
        flight.step(fast_motion)
        if flight.time > 1.0:
            farthest = max(farthest, float(np.linalg.norm(flight.state.position)))
            steepest = max(steepest, flight.tilt)
    assert not flight.plant.is_held
    assert 0.01 < farthest < 0.4  # it is moved by the arm, and not carried away
    assert steepest < 0.7


def fed(flight, motion, seconds: float, turning: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return position error [m] and tilt [rad] of a drone with a forecast of 60 ms.

    The commanded heading turns at a constant rate [rad/s].
    """
    drone = flight.plant.drone
    model = ArmLoadModel(load_robot(gravity_in_base=drone.gravity_in_base))
    seen = []
    while flight.time < seconds:
        ahead = flight.time + 0.06
        q, dq = motion(ahead)
        ddq = (motion(ahead + 1e-4)[1] - motion(ahead - 1e-4)[1]) / 2e-4
        load = model.evaluate(JointReference(q, dq, ddq))
        flight.arm.offer_inertia(ahead, load.mass, load.com, load.inertia)
        flight.arm.offer_motion(ahead, load.motion)
        flight.target = FlightTarget(np.zeros(3), turning * flight.time)
        flight.step(motion)
        seen.append((float(np.linalg.norm(flight.state.position)), flight.tilt))
    return np.array(seen).T


def test_feed_forward_of_the_arm_keeps_the_drone_in_place() -> None:
    drone, farthest = DRONES['3 kg tilted'], []
    for is_fed in (False, True):
        flight = Flight(drone)
        flight.arm = ArmFeedForward(drone, flight.body, is_fed, is_fed, lead=0.03)
        farthest.append(fed(flight, fast_motion, 2.5)[0].max())
    assert farthest[0] > 0.03
    # The arm hangs on springs here, so it does not quite do what was planned.
    assert farthest[1] < 0.4 * farthest[0]


def test_feed_forward_rotates_with_the_heading() -> None:
    """The tilt follows the arm's force in rotating axes."""
    flight = Flight(DRONES['3 kg'])
    flight.arm = ArmFeedForward(flight.plant.drone, flight.body, lead=0.03)
    off, tilt = fed(flight, fast_motion, 3.5, turning=2.0)
    assert off[500:].max() < 0.06
    assert tilt.max() < 0.25


def test_a_heading_error_causes_no_tilt() -> None:
    """The arm reaches out, so a product of inertia couples heading and tilt."""

    def reach(time: float) -> tuple[np.ndarray, np.ndarray]:
        s, out = min(1.0, time / 1.5), np.array([0.0, -np.pi / 2, 0.0, 0.0])
        share, slope = s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * s**2 * (1.0 - s) ** 2 / 1.5
        return HANGING + share * out, slope * out

    flight = Flight(DRONES['3 kg'])
    flight.arm = ArmFeedForward(flight.plant.drone, flight.body, lead=0.03)
    off, tilt = fed(flight, reach, 3.5, turning=2.0)
    assert abs(flight.state.rate[2] - 2.0) > 0.5  # it cannot turn as quickly
    assert off.max() < 0.06
    assert tilt.max() < 0.1


def test_a_wrong_mass_is_found_out_by_the_integral() -> None:
    drone = DRONES['3 kg']
    flight = Flight(drone, drone.with_errors(0.8, 0.8))
    while flight.time < 5.0:
        flight.step()
    np.testing.assert_allclose(flight.state.position, 0.0, atol=0.05)


def test_height_and_place_have_stiffnesses_of_their_own() -> None:
    """An error e causes a restoring force m w^2 e."""
    flight = Flight(DRONES['3 kg tilted'])
    gains = FlightGains(1.5, 4.0, position_integral=0.0, attitude_integral=0.0)
    control, body = FlightControl(flight.plant.drone, flight.body, gains), flight.body
    still = flight.state._replace(velocity=np.zeros(3), rotation=np.eye(3), rate=np.zeros(3))
    for axis, frequency in enumerate((1.5, 1.5, 4.0)):
        off = 0.01 * np.eye(3)[axis]
        target = FlightTarget(still.position + off, 0.0)
        thrusts = control.update(still, target, 0.004)
        force = (Allocation(flight.plant.drone).matrix @ thrusts)[:3] / body.mass
        np.testing.assert_allclose(force, [0.0, 0.0, 9.81] + frequency**2 * off, atol=1e-4)


@pytest.mark.parametrize('name', ['3 kg tilted', '1.3 kg quadrotor'])
def test_the_drone_flies_to_its_target_and_heading(name: str) -> None:
    flight = Flight(DRONES[name])
    flight.target = FlightTarget(np.array([0.5, -0.3, 0.4]), 0.6)
    fastest = steepest = 0.0
    while flight.time < 6.0:
        flight.step()
        fastest = max(fastest, float(np.linalg.norm(flight.state.velocity)))
        steepest = max(steepest, flight.tilt)
    np.testing.assert_allclose(flight.state.position, flight.target.position, atol=0.05)
    assert yaw_of(flight.state.rotation) == pytest.approx(0.6, abs=0.05)
    assert flight.tilt < 0.03
    assert fastest < 1.5
    assert not flight.plant.drone.is_fully_actuated or steepest < 0.06


def test_without_a_place_it_stays_level_and_sinks_slowly() -> None:
    flight = Flight(DRONES['3 kg'])
    while flight.time < 1.5:
        flight.step()
    flight.plant.push([0.0, 0.0, 0.0, 0.5, -0.5, 0.0])
    begun = flight.time
    while flight.time < begun + 2.0:
        state = flight.state
        lost = state._replace(position=np.zeros(3), velocity=np.zeros(3))
        flight.plant.rotors.command(flight.control.level(lost, 0.004))
        flight.hold_arm()
    assert flight.tilt < 0.05
    assert -1.5 < flight.state.velocity[2] < -0.1
