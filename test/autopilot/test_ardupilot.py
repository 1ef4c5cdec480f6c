"""ArduPilot's simulator connection, set points and start, with a replayed ArduCopter."""

import json
import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from ardupilot_recording import ReplayedArduPilot, flight
from px4_recording import BODY, DRONE, STILL, fly

from aerarm_ros.autopilot import ardupilot_link
from aerarm_ros.autopilot.ardupilot_link import JsonLink, motor_shares, sensor_line
from aerarm_ros.autopilot.ardupilot_loop import ArduPilotLoop, ArduPilotSetPoints
from aerarm_ros.autopilot.ardupilot_setup import ArduPilotSetup, motors_of
from aerarm_ros.autopilot.firmware_flight import FlightStage
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.px4_link import CompanionLink
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

PLACE = np.array([1.0, 2.0, 1.5])


def packet(number: int, share: float = 0.0) -> bytes:
    return struct.pack('<HHI16H', 18458, 400, number, *[round(1000 + 1000 * share)] * 16)


@pytest.fixture
def links() -> Iterator[tuple[JsonLink, CompanionLink, int, int]]:
    ports = []
    for _ in range(2):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(('127.0.0.1', 0))
            ports.append(free.getsockname()[1])
    simulator, companion = JsonLink(ports[0]), CompanionLink(ports[1], None)
    yield simulator, companion, *ports
    simulator.close()
    companion.close()


ENDED = 'ArduPilot has ended: restart ArduPilot and this node'


def test_the_firmware_is_led_into_the_air_as_it_was_when_recorded(links, monkeypatch) -> None:
    simulator, companion, *ports = links
    autopilot = ReplayedArduPilot(*ports)
    autopilot.start()
    control, firmware = flight(simulator, companion)
    fly(control)
    autopilot.join(20.0)
    assert autopilot.differing == []  # byte by byte, in both directions
    assert firmware.stage is FlightStage.FLY
    assert control.problem == ''
    thrust = control.update(STILL, FlightTarget.here(STILL), 0.0)
    assert 0.5 < thrust.sum() / (BODY.mass * GRAVITY) < 2.0
    # The recording ends in flight, and so does this ArduPilot.
    monkeypatch.setattr(ardupilot_link, '_PATIENCE', 0.2)
    control.update(STILL, FlightTarget.here(STILL), 0.004)
    assert firmware.problem == ENDED


def test_an_autopilot_that_ends_on_the_ground_is_named(links, monkeypatch) -> None:
    monkeypatch.setattr(ardupilot_link, '_PATIENCE', 0.2)
    simulator, companion, *ports = links
    autopilot = ReplayedArduPilot(*ports, ends_at=300)
    autopilot.start()
    control, firmware = flight(simulator, companion)
    fly(control)
    assert firmware.problem == ENDED
    assert autopilot.done == 300


def test_a_simulator_that_ends_ends_the_exchange(links) -> None:
    simulator, companion, *ports = links
    autopilot = ReplayedArduPilot(*ports, patience=0.5)
    autopilot.start()
    control, _ = flight(simulator, companion)
    control.update(STILL, FlightTarget.here(STILL), 0.004)
    simulator.close()
    autopilot.join(20.0)
    assert not autopilot.is_alive()
    assert autopilot.done < 10


def test_a_sensor_line_is_north_east_down() -> None:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # to the north
    state = FlightState(PLACE, np.array([0.1, 0.2, 0.3]), turned, np.array([0.4, 0.5, 0.6]))
    values = json.loads(sensor_line(2.5, state))
    assert values['timestamp'] == 2.5
    np.testing.assert_allclose(values['position'], [2.0, 1.0, -1.5])
    np.testing.assert_allclose(values['velocity'], [0.2, 0.1, -0.3])
    np.testing.assert_allclose(values['imu']['gyro'], [0.4, -0.5, -0.6])
    np.testing.assert_allclose(values['imu']['accel_body'], [0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(np.abs(values['quaternion']), [1.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_other_packets_are_no_motors() -> None:
    number, shares = motor_shares(packet(7, 0.25))
    assert number == 7
    np.testing.assert_allclose(shares, 0.25)
    wrong = b'\0\0' + packet(7)[2:]
    assert motor_shares(wrong) is None
    assert motor_shares(packet(7)[:-1]) is None


def test_a_taken_port_is_named(links) -> None:
    port = links[2]
    with pytest.raises(ValueError, match=f'UDP port {port}.*autopilot_instance'):
        JsonLink(port)


def test_rotors_are_found_by_angle_and_direction() -> None:
    names = [DRONE.rotor_names[index] for index in motors_of(DRONE)]
    assert names == ['right', 'left', 'front_left', 'rear_right', 'front_right', 'rear_left']
    quadrotor = load_drone_config(resource('config', 'drones', 'quadrotor.yaml'))
    assert sorted(motors_of(quadrotor)) == [0, 1, 2, 3]
    tilted = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
    with pytest.raises(ValueError, match='ArduPilot has no frame for'):
        motors_of(tilted)


def test_the_rate_gain_is_that_of_the_mixer() -> None:
    setup = ArduPilotSetup(rate_p=0.4)
    # Roll: two rotors at 0.35 m with half of the command, four at 0.175 m with a quarter.
    roll = 18.0 * (2 * 0.35 * 0.5 + 4 * 0.175 * 0.25)
    pitch = 18.0 * 4 * 0.303109 * 0.5
    assert setup.rate_gain(DRONE) == pytest.approx(0.4 * (roll + pitch) / 2, rel=1e-3)


@pytest.mark.parametrize('loop', [ArduPilotLoop(), ArduPilotLoop(1.5, 3.0, 0.5)])
def test_the_loop_commands_the_acceleration_while_the_drone_stays(loop: ArduPilotLoop) -> None:
    """Evaluate ArduCopter's loop for a drone at rest: the command is the acceleration alone."""
    points = ArduPilotSetPoints(loop, SetPointAcceleration())
    dt, total, worst = 0.004, np.zeros(2), 0.0
    for step in range(2000):
        force = np.array([3.0 * np.sin(1.5 * step * dt), 2.0, 1.0])
        arm = FeedForward(BODY, np.r_[force, 0, 0, 0], np.zeros(6), np.zeros(3), np.zeros(3))
        _, values = points.message(STILL, FlightTarget.here(STILL), dt, arm, np.zeros(3))
        offset = np.array([values['x'], values['y']])
        error = np.array([values['vx'], values['vy']]) + loop.position_p * offset
        total = total + dt * error
        command = np.array([values['afx'], values['afy']]) + loop.velocity_p * error
        command = command + loop.velocity_i * total
        wanted = -force * GRAVITY / (BODY.mass * GRAVITY - force[2])  # of a tilt by atan(a / g)
        worst = max(worst, np.abs(command - ned(wanted)[:2]).max())
        assert values['z'] == 0.0
        assert values['afz'] == 0.0
    assert worst < 0.02  # of up to 0.8 m/s^2
