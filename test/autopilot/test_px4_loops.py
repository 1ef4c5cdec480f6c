"""The benchmarks' model of PX4's loops, and a rigid drone under them with an arm's forces."""

import sys
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.px4_loops import Px4Flight, Px4Loops, Px4SetPoint, Px4State
from flying.px4_program import Px4AllGains

DRONE = load_drone_config()
BODY = MassProperties(4.5, np.zeros(3), np.diag([0.2, 0.2, 0.1]))
GAINS = Px4AllGains.scaled(1.2, 7.0, 4.0)
CYCLE = 0.004
W = 2.0 * np.pi * 0.6
FORCE, MOMENT = np.array([3.0, -2.0, 1.0]), np.array([0.5, 0.8, 0.0])


def told(time: float) -> FeedForward:
    """Return the feedforward of a swinging arm at a time."""
    s, c = np.sin(W * time), np.cos(W * time)
    wrench = np.concatenate([FORCE * s, MOMENT * c])
    return FeedForward(BODY, wrench, wrench, W * c * FORCE, -(W**2) * s * FORCE)


def turned(vector: np.ndarray) -> np.ndarray:
    """Return the rotation by a small vector, to second order."""
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + cross + 0.5 * cross @ cross


def distance(is_told: bool, knows_loops: bool = False, seconds: float = 5.0) -> float:
    """Return a pushed drone's RMS distance from its place [m] after 2 s."""
    flight = Px4Flight(DRONE, BODY, GAINS, knows_loops)
    place, velocity, rotation, rate = np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3)
    distances = []
    for cycle in range(round(seconds / CYCLE)):
        arm = told(cycle * CYCLE)
        thrusts = flight.update(
            FlightState(place, velocity, rotation, rate),
            FlightTarget(np.zeros(3), 0.0),
            CYCLE,
            arm if is_told else None,
        )
        wrench = DRONE.allocation @ thrusts + arm.wrench
        spin = np.linalg.solve(BODY.inertia, wrench[3:] - np.cross(rate, BODY.inertia @ rate))
        velocity = velocity + CYCLE * (rotation @ wrench[:3] / BODY.mass - [0.0, 0.0, GRAVITY])
        rate = rate + CYCLE * spin
        place = place + CYCLE * velocity
        u, _, v = np.linalg.svd(rotation @ turned(CYCLE * rate))
        rotation = u @ v
        distances.append(float(np.linalg.norm(place)))
    return float(np.sqrt(np.mean(np.square(distances[round(2.0 / CYCLE) :]))))


def test_an_acceleration_of_the_set_point_keeps_it_at_its_place() -> None:
    pushed, fed = distance(is_told=False), distance(is_told=True, knows_loops=True)
    assert pushed > 0.03
    assert fed < pushed / 5.0


@pytest.mark.parametrize('holds_heading', [True, False])
def test_a_heading_that_is_not_held_stays_where_it_is(holds_heading: bool) -> None:
    flight = Px4Flight(DRONE, BODY, GAINS, holds_heading=holds_heading)
    state = FlightState(np.zeros(3), np.zeros(3), turned(np.array([0.0, 0.0, 0.1])), np.zeros(3))
    wrench = DRONE.allocation @ flight.update(state, FlightTarget(np.zeros(3), 0.0), CYCLE)
    assert wrench[2] == pytest.approx(BODY.mass * GRAVITY)
    # Turned to the left; held, it is turned back.
    assert (wrench[5] < -1e-6) == holds_heading
    assert holds_heading or wrench[5] == pytest.approx(0.0, abs=1e-9)


def test_an_acceleration_leans_the_thrust_and_a_turn_is_answered_by_the_product_of_gains() -> None:
    zero, gains, hover = np.zeros(3), Px4AllGains(), 0.4
    north = Px4SetPoint(zero, 0.0, zero, np.array([2.0, 0.0, 0.0]))
    thrust, moment = Px4Loops(gains, hover).update(
        Px4State(zero, zero, np.eye(3), zero), north, CYCLE
    )
    assert thrust == pytest.approx(hover * np.hypot(1.0, 2.0 / GRAVITY))
    assert moment[1] < 0.0  # nose down
    np.testing.assert_allclose(moment[[0, 2]], 0.0, atol=1e-12)
    here = Px4SetPoint(zero, 0.0, zero, zero)
    attitude = [gains.mc_att_p, gains.mc_att_p, gains.mc_yaw_p]
    for axis, rate in enumerate((gains.mc_rate_p, gains.mc_rate_p, gains.mc_yawrate_p)):
        angle = 0.01 * np.eye(3)[axis]
        state = Px4State(zero, zero, turned(angle), zero)
        _, moment = Px4Loops(gains, hover).update(state, here, CYCLE)
        np.testing.assert_allclose(moment, -attitude[axis] * rate * angle, atol=2e-6)
