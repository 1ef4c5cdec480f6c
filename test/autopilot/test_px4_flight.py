"""A rigid drone under PX4's loops, with forces like those of an arm."""

import numpy as np
import pytest

from aerarm_ros.autopilot.px4 import Px4Gains
from aerarm_ros.autopilot.px4_loops import Px4Flight
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

DRONE = load_drone_config()
BODY = MassProperties(4.5, np.zeros(3), np.diag([0.2, 0.2, 0.1]))
GAINS = Px4Gains.scaled(1.2, 7.0, 4.0)
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


def test_the_force_is_taken_back_along_the_heading() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    arm = told(np.pi / (2.0 * W))
    x, y, z = SetPointAcceleration().update(arm, quarter, CYCLE)
    # The autopilot tilts by atan(a / g), and the rotors carry the weight without the arm's force.
    lift = BODY.mass * GRAVITY - FORCE[2]
    force = np.array([x / GRAVITY * lift, y / GRAVITY * lift, BODY.mass * z])
    np.testing.assert_allclose(force, quarter @ -FORCE)


def test_what_lasts_is_left_to_the_integral() -> None:
    acceleration = SetPointAcceleration(7.0, 3.0, integral_rate=2.0)
    still = FeedForward.at_rest(MassProperties(4.5, np.array([0.02, 0.0, 0.0]), BODY.inertia))
    level = np.eye(3)
    assert acceleration.update(still, level, CYCLE) == pytest.approx(0.0)
    moved = FeedForward.at_rest(MassProperties(4.5, np.array([0.04, 0.0, 0.0]), BODY.inertia))
    first = acceleration.update(moved, level, CYCLE)
    # The centre lies ahead: the nose would go down, so the thrust leans back.
    assert first[0] < -0.1
    for _ in range(1000):
        last = acceleration.update(moved, level, CYCLE)
    assert abs(last[0]) < 1e-3


@pytest.mark.parametrize('holds_heading', [True, False])
def test_a_heading_that_is_not_held_stays_where_it_is(holds_heading: bool) -> None:
    flight = Px4Flight(DRONE, BODY, GAINS, holds_heading=holds_heading)
    state = FlightState(np.zeros(3), np.zeros(3), turned(np.array([0.0, 0.0, 0.1])), np.zeros(3))
    wrench = DRONE.allocation @ flight.update(state, FlightTarget(np.zeros(3), 0.0), CYCLE)
    assert wrench[2] == pytest.approx(BODY.mass * GRAVITY)
    # Turned to the left; held, it is turned back.
    assert (wrench[5] < -1e-6) == holds_heading
    assert holds_heading or wrench[5] == pytest.approx(0.0, abs=1e-9)
