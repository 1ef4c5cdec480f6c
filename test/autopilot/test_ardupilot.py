"""ArduCopter's frames, gains, and set points for its position loop."""

import numpy as np
import pytest
from firmware_recording import BODY, DRONE, STILL

from aerarm_ros.autopilot.ardupilot import (
    ArduPilotLoop,
    ArduPilotSetPoints,
    ArduPilotSetup,
    motors_of,
)
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightTarget


def test_rotors_are_found_by_angle_and_direction() -> None:
    names = [DRONE.rotor_names[index] for index in motors_of(DRONE)]
    assert names == ['right', 'left', 'front_left', 'rear_right', 'front_right', 'rear_left']
    quadrotor = load_drone_config(resource('config', 'drones', 'quadrotor.yaml'))
    assert sorted(motors_of(quadrotor)) == [0, 1, 2, 3]
    tilted = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
    with pytest.raises(ValueError, match='ArduPilot has no frame for'):
        motors_of(tilted)


def test_the_rate_gain_is_that_of_the_mixer() -> None:
    # Roll: two rotors at 0.35 m with half of the command, four at 0.175 m with a quarter.
    roll = 18.0 * (2 * 0.35 * 0.5 + 4 * 0.175 * 0.25)
    pitch = 18.0 * 4 * 0.303109 * 0.5
    found = ArduPilotSetup(rate_p=0.4).rate_gain(DRONE)
    assert found == pytest.approx(0.4 * (roll + pitch) / 2, rel=1e-3)


@pytest.mark.parametrize('loop', [ArduPilotLoop(), ArduPilotLoop(1.5, 3.0, 0.5)])
def test_the_loop_commands_the_acceleration_while_the_drone_stays(loop: ArduPilotLoop) -> None:
    """Evaluate ArduCopter's loop for a drone at rest: the command is the acceleration alone."""
    points = ArduPilotSetPoints(loop, SetPointAcceleration())
    dt, total, worst = 0.004, np.zeros(2), 0.0
    for step in range(2000):
        force = np.array([3.0 * np.sin(1.5 * step * dt), 2.0, 1.0])
        arm = FeedForward(BODY, np.r_[force, 0, 0, 0], np.zeros(6), np.zeros(3), np.zeros(3))
        _, values = points.message(STILL, FlightTarget.here(STILL), dt, arm)
        error = np.array([values['vx'], values['vy']])
        error = error + loop.position_p * np.array([values['x'], values['y']])
        total = total + dt * error
        command = np.array([values['afx'], values['afy']]) + loop.velocity_p * error
        command = command + loop.velocity_i * total
        wanted = -force * GRAVITY / (BODY.mass * GRAVITY - force[2])  # of a tilt by atan(a / g)
        worst = max(worst, np.abs(command - ned(wanted)[:2]).max())
        assert (values['z'], values['afz']) == (0.0, 0.0)
    assert worst < 0.02  # of up to 0.8 m/s^2
