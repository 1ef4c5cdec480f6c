"""Lines over real sockets and a pseudo-terminal, and an autopilot at the other end."""

import os
import pty
import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter, Message
from aerarm_ros.autopilot.mavlink_autopilot import LOSS, MavlinkAutopilot
from aerarm_ros.autopilot.mavlink_line import SerialLine, UdpLine, open_line

RATES = {'attitude': 100.0, 'place': 100.0, 'imu': 200.0, 'outputs': 0.0}
ARMED_OFFBOARD = {'type': 13, 'autopilot': 12, 'base_mode': 209, 'custom_mode': 6 << 16}


class Wire:
    """Test line that stores sent frames and returns prepared messages."""

    damaged = 0

    def __init__(self) -> None:
        self.sent: list[Message] = []
        self._reader = FrameReader()

    def send(self, frame: bytes) -> None:
        self.sent += self._reader.feed(frame)

    def messages(self, patience: float = 0.0) -> list[Message]:
        return []

    def close(self) -> None:
        pass

    def commands(self) -> list[tuple[int, float]]:
        """Return the sent commands with their first parameter."""
        return [(m['command'], m['param1']) for m in self.sent if m.name == 'COMMAND_LONG']


def message(name: str, system: int = 1, component: int = 1, **values: object) -> Message:
    [found] = FrameReader().feed(FrameWriter(system, component).pack(name, **values))
    return found


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(('127.0.0.1', 0))
        found.settimeout(5.0)
        yield found


def test_a_listening_line_speaks_with_who_spoke_first_alone(peer: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    line = open_line(f'udp:{port}')
    line.send(b'nobody is there')
    heartbeat = FrameWriter(1, 1).pack('HEARTBEAT', type=2)
    peer.sendto(heartbeat, ('127.0.0.1', port))
    assert [found['type'] for found in line.messages(5.0)] == [2]
    line.send(heartbeat)
    assert peer.recv(512) == heartbeat
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(heartbeat, ('127.0.0.1', port))
    assert line.messages(0.2) == []
    line.close()


def test_a_line_to_an_address_speaks_first(peer: socket.socket) -> None:
    line = open_line('udp:{}:{}'.format(*peer.getsockname()))
    assert isinstance(line, UdpLine)
    frame = FrameWriter(245, 191).pack('HEARTBEAT', type=18)
    line.send(frame)
    assert peer.recv(512) == frame
    line.close()


def test_a_serial_line_is_raw_in_both_directions() -> None:
    far, near = pty.openpty()
    line = open_line(f'serial:{os.ttyname(near)}:57600')
    assert isinstance(line, SerialLine)
    frame = FrameWriter(1, 1).pack('HEARTBEAT', type=3, autopilot=13)  # 3 and 13: ^C and CR
    os.write(far, frame[:7])
    assert line.messages(0.05) == []
    os.write(far, frame[7:])
    [found] = line.messages(5.0)
    assert (found['type'], found['autopilot']) == (3, 13)
    damaged = bytearray(frame)
    damaged[-1] ^= 1
    os.write(far, bytes(damaged) + bytes(300))
    line.messages(1.0)
    assert line.damaged == 1
    line.send(frame)
    assert os.read(far, 512) == frame
    os.close(far)
    with pytest.raises(OSError, match=r'.'):
        for _ in range(100):
            line.messages(0.01)
    line.close()
    os.close(near)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('tcp:1', 'udp:PORT'),
        ('udp', 'udp:PORT'),
        ('udp::14550', 'udp:PORT'),
        ('serial:57600', 'serial:DEVICE:BAUD'),
        ('serial:/dev/no_such_tty:57600', 'No such file'),
        ('serial:/dev/null:57600', 'not a serial device'),
        ('udp:127.0.0.1:99999999', 'udp:HOST:PORT'),
        ('udp:no.such.host.invalid:5', 'connection'),
    ],
)
def test_a_line_that_cannot_be_opened_says_what_to_give(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        open_line(text).send(b'x')


def test_it_neither_arms_nor_changes_the_mode_unless_asked_by_name() -> None:
    wire = Wire()
    autopilot = MavlinkAutopilot(wire, RATES)
    for tick in range(200):
        autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 0.1 * tick)
        autopilot.tick(0.1 * tick)
        autopilot.set_point('SET_POSITION_TARGET_LOCAL_NED', 0.1 * tick, x=1.0)
    assert {command for command, _ in wire.commands()} == {511}  # message intervals
    assert {m.name for m in wire.sent} == {
        'HEARTBEAT', 'COMMAND_LONG', 'SET_POSITION_TARGET_LOCAL_NED',
    }  # fmt: skip
    wire.sent.clear()
    autopilot.arm()
    autopilot.disarm()
    autopilot.offboard()
    assert wire.commands() == [(400, 1.0), (400, 0.0), (176, 1.0)]


def test_streams_are_asked_for_at_each_new_link_and_while_they_do_not_come() -> None:
    wire = Wire()
    autopilot = MavlinkAutopilot(wire, RATES)
    autopilot.tick(0.0)
    assert wire.commands() == []  # nobody is there
    autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 0.1)
    autopilot.tick(0.1)
    assert [int(number) for _, number in wire.commands()] == [31, 32, 105]
    wire.sent.clear()
    for tick in range(1, 60):
        now = 0.1 + 0.1 * tick
        autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), now)
        for name in ('ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED'):
            autopilot.take(message(name, q1=1.0) if 'q' in name.lower() and 'ATT' in name
                           else message(name), now)  # fmt: skip
        autopilot.tick(now)
    assert {int(number) for _, number in wire.commands()} == {105}
    assert autopilot.silent(6.0) == ['imu']


def test_link_mode_and_arming_are_followed() -> None:
    autopilot = MavlinkAutopilot(Wire(), RATES)
    assert not autopilot.is_linked(0.0)
    autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 10.0)
    assert autopilot.is_linked(10.0 + LOSS)
    assert not autopilot.is_linked(10.1 + LOSS)
    assert (autopilot.is_armed, autopilot.mode) == (True, 'offboard')
    hold = {**ARMED_OFFBOARD, 'base_mode': 81, 'custom_mode': 3 << 24 | 4 << 16}
    autopilot.take(message('HEARTBEAT', **hold), 11.0)
    assert (autopilot.is_armed, autopilot.mode) == (False, 'auto hold')
    # Another vehicle on the same line, and a camera of this one.
    assert not autopilot.take(message('HEARTBEAT', system=2, **ARMED_OFFBOARD), 12.0)
    assert not autopilot.take(message('HEARTBEAT', component=100, **ARMED_OFFBOARD), 12.0)
    assert not autopilot.is_armed


def test_place_attitude_and_imu_come_in_the_frames_of_ros() -> None:
    autopilot = MavlinkAutopilot(Wire(), RATES)
    # Heading north: the body's x axis is ROS's north, y of its world.
    autopilot.take(message('ATTITUDE_QUATERNION', q1=1.0, yawspeed=0.3), 0.0)
    autopilot.take(message('LOCAL_POSITION_NED', x=1.0, y=2.0, z=-3.0, vx=0.1), 0.0)
    autopilot.take(message('HIGHRES_IMU', zacc=-9.8, xgyro=0.1, zgyro=0.2), 0.0)
    state = autopilot.state(0.1)
    assert state is not None
    np.testing.assert_allclose(state.position, [2.0, 1.0, 3.0])
    np.testing.assert_allclose(state.velocity, [0.0, 0.1, 0.0], atol=1e-7)
    np.testing.assert_allclose(state.rotation[:, 0], [0.0, 1.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(state.rate, [0.0, 0.0, -0.3], rtol=1e-6)
    assert autopilot.imu is not None
    np.testing.assert_allclose(autopilot.imu.force, [0.0, 0.0, 9.8], rtol=1e-6)
    np.testing.assert_allclose(autopilot.imu.rate, [0.1, 0.0, -0.2], rtol=1e-6)
    assert autopilot.state(0.3) is None  # old


def test_what_is_no_number_is_not_used() -> None:
    autopilot = MavlinkAutopilot(Wire(), RATES)
    nan = float('nan')
    autopilot.take(message('ATTITUDE_QUATERNION', q1=nan), 0.0)
    autopilot.take(message('LOCAL_POSITION_NED', x=nan), 0.0)
    autopilot.take(message('HIGHRES_IMU', xacc=nan), 0.0)
    assert autopilot.state(0.0) is None
    assert autopilot.imu is None
    assert 'not a unit quaternion' in autopilot.text


def test_an_answer_to_a_command_is_told_by_name() -> None:
    autopilot = MavlinkAutopilot(Wire(), RATES)
    autopilot.arm()
    assert autopilot.reply == ''
    autopilot.take(message('COMMAND_ACK', command=511, result=0), time.monotonic())
    assert autopilot.reply == ''
    autopilot.take(message('COMMAND_ACK', command=400, result=1), time.monotonic())
    assert autopilot.reply == 'temporarily rejected'
