"""ArduPilot's simulator connection, set points and start, with a scripted ArduCopter."""

import json
import socket
import struct
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from aerarm_ros.autopilot import ardupilot_link
from aerarm_ros.autopilot.ardupilot_flight import ArduPilotFirmware, ArduPilotStage
from aerarm_ros.autopilot.ardupilot_link import JsonLink, motor_shares
from aerarm_ros.autopilot.ardupilot_loop import ArduPilotLoop, ArduPilotSetPoints
from aerarm_ros.autopilot.ardupilot_setup import ArduPilotSetup, motors_of
from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.px4_flight import FirmwareFlight
from aerarm_ros.autopilot.px4_link import CompanionLink
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

DRONE = load_drone_config()
BODY = MassProperties(4.5, np.zeros(3), np.diag([0.2, 0.2, 0.1]))
PLACE = np.array([1.0, 2.0, 1.5])
STILL = FlightState(PLACE, np.zeros(3), np.eye(3), np.zeros(3))
GUIDED, ARMED = 4, 128
HOVER = 0.55


def packet(number: int, share: float = 0.0) -> bytes:
    return struct.pack('<HHI16H', 18458, 400, number, *[round(1000 + 1000 * share)] * 16)


@dataclass
class ScriptedArduPilot:
    """Answer as ArduCopter: ask for sensors, take guided mode, arming and a take-off.

    Attributes
    ----------
    falls_silent : int
        Number of sensor lines after which it ends; 0 for never.
    """

    port: int
    mavlink_port: int
    falls_silent: int = 0
    lines: list[dict] = field(default_factory=list)
    commands: list[int] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    mode: int = 0
    flags: int = 0
    share: float = 0.0

    def __post_init__(self) -> None:
        self._model = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._model.settimeout(0.1)
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.setblocking(False)
        self._writer, self._reader = FrameWriter(1, 1), FrameReader()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._model.close()
        self._line.close()

    def _run(self) -> None:
        number = 0
        while not self._ends.is_set():
            self._model.sendto(packet(number, self.share), ('127.0.0.1', self.port))
            try:
                data = self._model.recv(4096)
            except (TimeoutError, ConnectionRefusedError):
                continue  # repeats the packet, as ArduPilot does
            self.lines.append(json.loads(data))
            number += 1
            if number == self.falls_silent:
                return
            self._listen()
            if number % 5 == 0:
                self._report()
            if 22 in self.commands:
                self.share = min(self.share + 0.01, 0.9)

    def _listen(self) -> None:
        try:
            data = self._line.recv(65536)
        except (BlockingIOError, ConnectionRefusedError):
            return
        for message in self._reader.feed(data):
            self.names.add(message.name)
            if message.name == 'COMMAND_LONG':
                self.commands.append(message['command'])
                if message['command'] == 176:
                    self.mode = int(message['param2'])
                if message['command'] == 400 and self.mode == GUIDED:
                    self.flags = ARMED

    def _report(self) -> None:
        frames = [self._writer.pack('HEARTBEAT', custom_mode=self.mode, base_mode=self.flags)]
        if 511 in self.commands:
            x, y, z = ned(PLACE).tolist()
            frames.append(self._writer.pack('LOCAL_POSITION_NED', x=x, y=y, z=z))
        for frame in frames:
            self._line.sendto(frame, ('127.0.0.1', self.mavlink_port))


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


def test_the_held_drone_is_armed_lifted_and_released(links) -> None:
    simulator, companion, *ports = links
    autopilot = ScriptedArduPilot(*ports)
    firmware = ArduPilotFirmware(simulator, companion, motors_of(DRONE))
    set_points = ArduPilotSetPoints(ArduPilotLoop(), SetPointAcceleration())
    flight = FirmwareFlight(DRONE, BODY, firmware, set_points)
    try:
        flight.update(STILL, FlightTarget.here(STILL), 0.004)
        for _ in range(3000):
            if not flight.is_settling:
                break
            flight.settle()
        assert firmware.stage is ArduPilotStage.FLY, firmware.problem
        for _ in range(20):
            flight.update(STILL, FlightTarget.here(STILL), 0.004)
    finally:
        autopilot.close()
    assert {176, 400, 22, 511} <= set(autopilot.commands)
    assert {'ODOMETRY', 'SET_GPS_GLOBAL_ORIGIN', 'SET_POSITION_TARGET_LOCAL_NED'} <= autopilot.names
    # Time goes on by 1 ms per line, and the frames are north-east-down and forward-right-down.
    stamps = np.array([line['timestamp'] for line in autopilot.lines])
    np.testing.assert_allclose(np.diff(stamps), 0.001, atol=1e-9)
    np.testing.assert_allclose(autopilot.lines[0]['position'], ned(PLACE))
    np.testing.assert_allclose(autopilot.lines[0]['imu']['accel_body'], [0.0, 0.0, -GRAVITY])


def test_an_autopilot_that_ends_is_named(links, monkeypatch) -> None:
    monkeypatch.setattr(ardupilot_link, '_PATIENCE', 0.2)
    simulator, companion, *ports = links
    autopilot = ScriptedArduPilot(*ports, falls_silent=40)
    firmware = ArduPilotFirmware(simulator, companion, motors_of(DRONE))
    try:
        for _ in range(30):
            firmware.hold(STILL, HOVER)
    finally:
        autopilot.close()
    assert firmware.problem == 'ArduPilot has ended: restart ArduPilot and this node'


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
        offset = np.array([values['x'], values['y']]) - ned(PLACE)[:2]
        error = np.array([values['vx'], values['vy']]) + loop.position_p * offset
        total = total + dt * error
        command = np.array([values['afx'], values['afy']]) + loop.velocity_p * error
        command = command + loop.velocity_i * total
        worst = max(worst, np.abs(command - ned(-force / BODY.mass)[:2]).max())
        assert values['z'] == pytest.approx(-PLACE[2])
        assert values['afz'] == 0.0
    assert worst < 0.02  # of up to 0.8 m/s^2
