"""The benchmarks' estimates of a constant push, from the drone's momentum and from its IMU."""

import sys
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.flight.arm_load import MassProperties
from aerarm_ros.flight.flight_state import FlightState

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.rejection import Disturbance, DisturbanceObserver, IncrementalEstimate

DRONE = load_drone_config()
BODY = MassProperties(4.5, np.array([0.02, 0.01, -0.15]), np.diag([0.3, 0.3, 0.12]))
FORCE, MOMENT = np.array([1.5, -0.8, 0.6]), np.array([0.05, -0.04, 0.02])
STEP = 1e-3


@pytest.mark.parametrize(
    'estimate',
    [DisturbanceObserver(10.0), IncrementalEstimate(DRONE, 25.0)],
    ids=['momentum', 'imu'],
)
def test_a_push_is_found(estimate: Disturbance) -> None:
    """A rigid body under hovering rotors, pushed and turned about its centre of mass."""
    hover = np.array([0.0, 0.0, BODY.mass * GRAVITY])
    wrench = np.concatenate([hover, np.cross(BODY.centre, hover)])
    rate, velocity = np.zeros(3), np.zeros(3)  # of the centre of mass
    lever = np.array(DRONE.imu.position) - BODY.centre
    found = np.zeros(6)
    for _ in range(1000):
        spin = np.linalg.solve(BODY.inertia, MOMENT - np.cross(rate, BODY.inertia @ rate))
        acceleration = FORCE / BODY.mass
        felt = acceleration + [0.0, 0.0, GRAVITY]
        felt = felt + np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
        velocity, rate = velocity + STEP * acceleration, rate + STEP * spin
        origin = velocity - np.cross(rate, BODY.centre)
        state = FlightState(np.zeros(3), origin, np.eye(3), rate, felt)
        found = estimate.update(state, BODY, wrench, STEP)
    np.testing.assert_allclose(found[:3], FORCE, atol=0.02)
    np.testing.assert_allclose(found[3:], MOMENT, atol=2e-3)
