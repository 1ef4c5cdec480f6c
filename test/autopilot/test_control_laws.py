"""The benchmarks' control laws on rigid drones: PX4's loops, and estimates of a push."""

import numpy as np
import pytest
from firmware_recording import DRONE
from flying.compared_flight import Disturbance, DisturbanceObserver, IncrementalEstimate
from flying.firmware_program import Px4AllGains
from flying.px4_loops import Px4Flight, Px4Loops, Px4SetPoint, Px4State
from scipy.spatial.transform import Rotation

from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

BODY = MassProperties(4.5, np.zeros(3), np.diag([0.2, 0.2, 0.1]))
GAINS = Px4AllGains.scaled(1.2, 7.0, 4.0)
CYCLE = 0.004
W = 2.0 * np.pi * 0.6
FORCE, MOMENT = np.array([3.0, -2.0, 1.0]), np.array([0.5, 0.8, 0.0])
HERE = FlightTarget(np.zeros(3), 0.0)


def distance(is_told: bool) -> float:
    """Return a pushed drone's RMS distance from its place [m] after 2 s."""
    flight = Px4Flight(DRONE, BODY, GAINS, knows_loops=is_told)
    place, velocity, rotation, rate = np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3)
    distances = []
    for cycle in range(round(5.0 / CYCLE)):
        s, c = np.sin(W * cycle * CYCLE), np.cos(W * cycle * CYCLE)
        wrench = np.concatenate([FORCE * s, MOMENT * c])
        arm = FeedForward(BODY, wrench, wrench, W * c * FORCE, -(W**2) * s * FORCE)
        state = FlightState(place, velocity, rotation, rate)
        thrusts = flight.update(state, HERE, CYCLE, arm if is_told else None)
        wrench = DRONE.allocation @ thrusts + wrench
        spin = np.linalg.solve(BODY.inertia, wrench[3:] - np.cross(rate, BODY.inertia @ rate))
        velocity = velocity + CYCLE * (rotation @ wrench[:3] / BODY.mass - [0.0, 0.0, GRAVITY])
        rate = rate + CYCLE * spin
        place = place + CYCLE * velocity
        rotation = rotation @ Rotation.from_rotvec(CYCLE * rate).as_matrix()
        distances.append(float(np.linalg.norm(place)))
    return float(np.sqrt(np.mean(np.square(distances[round(2.0 / CYCLE) :]))))


def test_an_acceleration_of_the_set_point_keeps_it_at_its_place() -> None:
    pushed = distance(is_told=False)
    assert pushed > 0.03
    assert distance(is_told=True) < pushed / 5.0


def test_px4_leans_the_thrust_and_answers_a_turn_by_the_product_of_gains() -> None:
    zero, gains, hover = np.zeros(3), Px4AllGains(), 0.4
    north = Px4SetPoint(zero, 0.0, zero, np.array([2.0, 0.0, 0.0]))
    thrust, moment = Px4Loops(gains, hover).update(
        Px4State(zero, zero, np.eye(3), zero), north, CYCLE
    )
    assert thrust == pytest.approx(hover * np.hypot(1.0, 2.0 / GRAVITY))
    assert moment[1] < 0.0  # nose down
    np.testing.assert_allclose(moment[[0, 2]], 0.0, atol=1e-12)
    attitude = [gains.mc_att_p, gains.mc_att_p, gains.mc_yaw_p]
    rates = [gains.mc_rate_p, gains.mc_rate_p, gains.mc_yawrate_p]
    for angle, product in zip(0.01 * np.eye(3), np.multiply(attitude, rates), strict=True):
        state = Px4State(zero, zero, Rotation.from_rotvec(angle).as_matrix(), zero)
        for yaw, share in ((0.0, 1.0), (np.nan, float(angle[2] == 0.0))):  # NaN: not held
            here = Px4SetPoint(zero, yaw, zero, zero)
            _, moment = Px4Loops(gains, hover).update(state, here, CYCLE)
            np.testing.assert_allclose(moment, -share * product * angle, atol=2e-6)


@pytest.mark.parametrize('estimate', [DisturbanceObserver(10.0), IncrementalEstimate(DRONE, 25.0)])
def test_a_push_is_found(estimate: Disturbance) -> None:
    """A rigid body under hovering rotors, pushed and turned about its centre of mass."""
    body = MassProperties(4.5, np.array([0.02, 0.01, -0.15]), np.diag([0.3, 0.3, 0.12]))
    force, moment = np.array([1.5, -0.8, 0.6]), np.array([0.05, -0.04, 0.02])
    hover, step = np.array([0.0, 0.0, body.mass * GRAVITY]), 1e-3
    wrench = np.concatenate([hover, np.cross(body.centre, hover)])
    rate, velocity = np.zeros(3), np.zeros(3)  # of the centre of mass
    lever = np.array(DRONE.imu.position) - body.centre
    for _ in range(1000):
        spin = np.linalg.solve(body.inertia, moment - np.cross(rate, body.inertia @ rate))
        felt = force / body.mass + [0.0, 0.0, GRAVITY]
        felt = felt + np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
        velocity, rate = velocity + step * force / body.mass, rate + step * spin
        origin = velocity - np.cross(rate, body.centre)
        state = FlightState(np.zeros(3), origin, np.eye(3), rate, felt)
        found = estimate.update(state, body, wrench, step)
    np.testing.assert_allclose(found[:3], force, atol=0.02)
    np.testing.assert_allclose(found[3:], moment, atol=2e-3)
