"""Lines over real sockets and a pseudo-terminal, and an autopilot at the other end."""

import os
import pty
import socket

import numpy as np
import pytest

from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter, Message
from aerarm_ros.autopilot.mavlink_autopilot import LOSS, MavlinkAutopilot
from aerarm_ros.autopilot.mavlink_line import open_line

RATES = {'attitude': 100.0, 'place': 100.0, 'imu': 200.0, 'outputs': 0.0}
ARMED_OFFBOARD = {'type': 13, 'autopilot': 12, 'base_mode': 209, 'custom_mode': 6 << 16}


class Wire:
    """Test line that stores sent frames."""

    def __init__(self) -> None:
        self.sent: list[Message] = []
        self._reader = FrameReader()

    def send(self, frame: bytes) -> None:
        self.sent += self._reader.feed(frame)

    def commands(self) -> list[tuple[int, float]]:
        """Return the sent commands with their first parameter."""
        return [(m['command'], m['param1']) for m in self.sent if m.name == 'COMMAND_LONG']


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def autopilot(wire: Wire) -> MavlinkAutopilot:
    return MavlinkAutopilot(wire, RATES)


def message(name: str, system: int = 1, component: int = 1, **values: object) -> Message:
    [found] = FrameReader().feed(FrameWriter(system, component).pack(name, **values))
    return found


def udp_socket() -> tuple[socket.socket, int]:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.bind(('127.0.0.1', 0))
    found.settimeout(5.0)
    return found, found.getsockname()[1]


HEARTBEAT = FrameWriter(1, 1).pack('HEARTBEAT', type=3, autopilot=13)  # 3 and 13: ^C and CR


def test_a_listening_line_speaks_with_who_spoke_first_alone() -> None:
    probe, port = udp_socket()
    probe.close()
    line = open_line(f'udp:{port}')
    line.send(b'nobody is there')
    (peer, address), (stranger, _) = udp_socket(), udp_socket()
    with peer, stranger:
        peer.sendto(HEARTBEAT, ('127.0.0.1', port))
        assert [found['type'] for found in line.messages(5.0)] == [3]
        line.send(HEARTBEAT)
        assert peer.recv(512) == HEARTBEAT
        stranger.sendto(HEARTBEAT, ('127.0.0.1', port))
        assert line.messages(0.2) == []
        line.close()
        line = open_line(f'udp:127.0.0.1:{address}')  # to an address: speaks first
        line.send(HEARTBEAT)
        assert peer.recv(512) == HEARTBEAT
    line.close()


def test_a_serial_line_is_raw_in_both_directions() -> None:
    far, near = pty.openpty()
    line = open_line(f'serial:{os.ttyname(near)}:57600')
    os.write(far, HEARTBEAT[:7])
    assert line.messages(0.05) == []
    os.write(far, HEARTBEAT[7:])
    [found] = line.messages(5.0)
    assert (found['type'], found['autopilot']) == (3, 13)
    os.write(far, HEARTBEAT[:-1] + bytes([HEARTBEAT[-1] ^ 1]) + bytes(300))
    line.messages(1.0)
    assert line.damaged == 1
    line.send(HEARTBEAT)
    assert os.read(far, 512) == HEARTBEAT
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


def test_it_neither_arms_nor_changes_the_mode_unless_asked_by_name(
    wire: Wire, autopilot: MavlinkAutopilot
) -> None:
    for tick in range(200):
        autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 0.1 * tick)
        autopilot.tick(0.1 * tick)
        autopilot.set_point('SET_POSITION_TARGET_LOCAL_NED', 0.1 * tick, x=1.0)
    assert {command for command, _ in wire.commands()} == {511}  # message intervals
    names = {m.name for m in wire.sent}
    assert names == {'HEARTBEAT', 'COMMAND_LONG', 'SET_POSITION_TARGET_LOCAL_NED'}
    wire.sent.clear()
    autopilot.arm()
    autopilot.disarm()
    autopilot.offboard()
    assert wire.commands() == [(400, 1.0), (400, 0.0), (176, 1.0)]
    # Answers to other commands are ignored.
    for command, result, reply in ((511, 0, ''), (400, 1, 'temporarily rejected')):
        autopilot.take(message('COMMAND_ACK', command=command, result=result), 0.0)
        assert autopilot.reply == reply


def test_streams_are_asked_for_at_each_new_link_and_while_they_do_not_come(
    wire: Wire, autopilot: MavlinkAutopilot
) -> None:
    autopilot.tick(0.0)
    assert wire.commands() == []  # nobody is there
    autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 0.1)
    autopilot.tick(0.1)
    assert [int(number) for _, number in wire.commands()] == [31, 32, 105]
    wire.sent.clear()
    for tick in range(1, 60):
        now = 0.1 + 0.1 * tick
        autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), now)
        autopilot.take(message('ATTITUDE_QUATERNION', q1=1.0), now)
        autopilot.take(message('LOCAL_POSITION_NED'), now)
        autopilot.tick(now)
    assert {int(number) for _, number in wire.commands()} == {105}
    assert autopilot.silent(6.0) == ['imu']


def test_link_mode_and_arming_are_followed(autopilot: MavlinkAutopilot) -> None:
    assert not autopilot.is_linked(0.0)
    autopilot.take(message('HEARTBEAT', **ARMED_OFFBOARD), 10.0)
    assert autopilot.is_linked(10.0 + LOSS)
    assert not autopilot.is_linked(10.1 + LOSS)
    assert (autopilot.is_armed, autopilot.mode) == (True, 'offboard')
    hold = {**ARMED_OFFBOARD, 'base_mode': 81, 'custom_mode': 3 << 24 | 4 << 16}
    autopilot.take(message('HEARTBEAT', **hold), 11.0)
    # Another vehicle on the same line, and a camera of this one.
    assert not autopilot.take(message('HEARTBEAT', system=2, **ARMED_OFFBOARD), 12.0)
    assert not autopilot.take(message('HEARTBEAT', component=100, **ARMED_OFFBOARD), 12.0)
    assert (autopilot.is_armed, autopilot.mode) == (False, 'auto hold')


def test_place_attitude_and_imu_come_in_the_frames_of_ros(autopilot: MavlinkAutopilot) -> None:
    for name, values in (  # no numbers: not used
        ('ATTITUDE_QUATERNION', {'q1': np.nan}),
        ('LOCAL_POSITION_NED', {'x': np.nan}),
        ('HIGHRES_IMU', {'xacc': np.nan}),
    ):
        autopilot.take(message(name, **values), 0.0)
    assert (autopilot.state(0.0), autopilot.imu) == (None, None)
    assert 'not a unit quaternion' in autopilot.text
    # Heading north: the body's x axis is ROS's north, y of its world.
    autopilot.take(message('ATTITUDE_QUATERNION', q1=1.0, yawspeed=0.3), 0.0)
    autopilot.take(message('LOCAL_POSITION_NED', x=1.0, y=2.0, z=-3.0, vx=0.1), 0.0)
    autopilot.take(message('HIGHRES_IMU', zacc=-9.8, xgyro=0.1, zgyro=0.2), 0.0)
    state = autopilot.state(0.1)
    np.testing.assert_allclose(state.position, [2.0, 1.0, 3.0])
    np.testing.assert_allclose(state.velocity, [0.0, 0.1, 0.0], atol=1e-7)
    np.testing.assert_allclose(state.rotation[:, 0], [0.0, 1.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(state.rate, [0.0, 0.0, -0.3], rtol=1e-6)
    np.testing.assert_allclose(autopilot.imu.force, [0.0, 0.0, 9.8], rtol=1e-6)
    np.testing.assert_allclose(autopilot.imu.rate, [0.1, 0.0, -0.2], rtol=1e-6)
    assert autopilot.state(0.3) is None  # old
