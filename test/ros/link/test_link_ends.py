"""The ends of ground_link, over UDP of this host."""

import socket
import struct
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.link.connection import PROMPT, URGENT, Connection, Received
from aerarm_ros.link.sealed import make_key
from aerarm_ros.ros.link.link_ends import DroneEnd, RemoteControllers
from aerarm_ros.ros.link.relayed_topics import STOPS, UP_CHANNEL
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.process.shared_ports import WAIT_MS

KEY = bytes(range(32))


class WatchedEnd(DroneEnd):
    """A drone's end that notes what it processes."""

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        super().__init__(node, values, KEY)
        self.order: list[int] = []

    def _take(self, received: Received) -> None:
        self.order.append(received.channel)
        super()._take(received)


@pytest.fixture
def values(tmp_path: Path) -> SimpleNamespace:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    return SimpleNamespace(
        address='127.0.0.1',
        port=port,
        ground='',
        rate=50.0,
        values_rate=10.0,
        ground_timeout=0.0,
        ground_lost='stop',
        config='',
        tf_prefix='',
        bags=str(tmp_path),
    )


class Ground:
    """The ground's connection, on a socket of this host."""

    def __init__(self, end: DroneEnd, port: int) -> None:
        self.end = end
        self.connection = Connection(KEY, 'ground', 'drone', 1e6)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(('127.0.0.1', 0))
        self._drone = '127.0.0.1', port
        self.ahead_ns = 0  # of this host's clock
        self.deadline = time.monotonic() + 60.0

    def send(self) -> None:
        now_ns, system_ns = time.monotonic_ns(), time.time_ns() + self.ahead_ns
        datagram = self.connection.datagram(1e-9 * now_ns, now_ns, system_ns)
        self._socket.sendto(datagram, self._drone)

    def step(self) -> None:
        """Send, let the drone answer, and receive."""
        assert time.monotonic() < self.deadline
        self.send()
        self.end.step()
        with suppress(BlockingIOError):
            while True:
                datagram, now_ns = self._socket.recv(2048), time.monotonic_ns()
                self.connection.receive(datagram, 1e-9 * now_ns, now_ns, now_ns)
                if self.connection.answer is not None:
                    self._socket.sendto(self.connection.answer, self._drone)

    @property
    def is_joined(self) -> bool:
        return self.connection.is_joined and self.end.connection.is_joined

    def close(self) -> None:
        self._socket.close()
        self.end.close()


def test_an_e_stop_comes_before_commands_that_arrived_earlier(
    ros_node: Node, values: SimpleNamespace
) -> None:
    end = WatchedEnd(ros_node, values)
    ground = Ground(end, values.port)
    while not ground.is_joined:
        ground.step()
    command = serialize_message(JointState(name=['joint1'], position=[0.0]))
    for priority, channel, payload in (
        *((PROMPT, UP_CHANNEL + 3, command),) * 5,
        (URGENT, STOPS, b'\1\0\0\0\5\0/stop'),
    ):
        ground.connection.send(channel, payload, priority)
        ground.send()
    while len(end.order) < 6:
        assert time.monotonic() < ground.deadline
        end.step()
    assert end.order == [STOPS, *[UP_CHANNEL + 3] * 5]
    ground.close()


@pytest.fixture
def problems(ros_node: Node) -> list[str]:
    """Return the messages on /diagnostics."""
    came: list[str] = []
    topic = topics.DIAGNOSTICS
    ros_node.create_subscription(
        topic.type,
        topic.name,
        lambda message: came.extend(status.message for status in message.status),
        topic.qos,
    )
    return came


@pytest.mark.parametrize(
    ('ahead', 'problem'),
    [
        (0.0, ''),
        (30.0, "the ground's clock is 30000 ms ahead of this host's clock: run chrony or PTP"),
        (-0.5, "the ground's clock is 500 ms behind this host's clock: run chrony or PTP"),
    ],
)
def test_different_clocks_are_reported(
    ros_node: Node, values: SimpleNamespace, problems: list[str], ahead: float, problem: str
) -> None:
    end = WatchedEnd(ros_node, values)
    ground = Ground(end, values.port)
    ground.ahead_ns = int(1e9 * ahead)
    while not np.isfinite(end.connection.clock_offset):
        ground.step()
    while not problems or 'no ground found' in problems[-1]:
        ground.step()
        rclpy.spin_once(ros_node, timeout_sec=0.01)
    assert problem in problems[-1]
    assert bool(problem) == ('clock' in problems[-1])
    ground.close()


def test_a_controller_on_the_ground_is_named(ros_node: Node) -> None:
    remote = RemoteControllers(ros_node)
    assert remote.problem() == ''
    other = rclpy.create_node('computed_torque')
    command = topics.JOINT_COMMAND
    other.create_publisher(command.type, command.name, command.offered)
    deadline = time.monotonic() + 60.0
    while not remote.problem():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert remote.problem().startswith(
        '/computed_torque cannot command the arm from this host: ground_link does not'
    )
    other.destroy_node()


def test_a_drone_with_an_address_of_its_ground_ignores_others(
    ros_node: Node, values: SimpleNamespace, problems: list[str]
) -> None:
    values.ground = '127.0.0.2'
    other = Ground(WatchedEnd(ros_node, values), values.port)
    wanted = (
        'ground_link ignores datagrams from 127.0.0.1, because the parameter ground is 127.0.0.2: '
        'set ground:='
    )
    while not any(wanted in text for text in problems):
        other.step()
        rclpy.spin_once(ros_node, timeout_sec=0.01)
    assert not other.is_joined
    other.close()
    values.ground = '127.0.0.1'
    right = Ground(WatchedEnd(ros_node, values), values.port)
    while not right.is_joined:
        right.step()
    right.close()


def test_an_address_that_is_unknown_is_an_error(ros_node: Node, values: SimpleNamespace) -> None:
    values.ground = 'no host'
    with pytest.raises(ValueError, match="'no host' in the parameter ground is unknown"):
        WatchedEnd(ros_node, values)


def own_ports() -> set[Path]:
    """Return the shared-memory ports that this process uses."""
    lines = Path('/proc/self/maps').read_text().splitlines()
    return {
        Path(line.split()[-1])
        for line in lines
        if '/fastrtps_port' in line and not line.endswith(('_el', '_sl'))
    }


@pytest.mark.skipif(not Path('/dev/shm').is_dir(), reason='no shared memory folder: Linux only')
def test_no_publisher_waits_for_a_new_subscriber(ros_node: Node, tmp_path: Path) -> None:
    """The ground has no bridge, whose watch shortens the wait of ports on the drone."""
    make_key(tmp_path / 'key')
    given = {'role': 'ground', 'drone': '127.0.0.1', 'key_file': str(tmp_path / 'key')}
    ports = own_ports()
    assert ports, 'this node uses no shared memory'
    with NodeProcess('ground_link', (), given, None, tmp_path / 'ground_link.log') as process:
        deadline = time.monotonic() + 30.0
        while not all(has_short_wait(path) for path in ports if path.exists()):
            assert time.monotonic() < deadline
            assert process.returncode is None, process.tail()
            time.sleep(0.05)


def has_short_wait(path: Path) -> bool:
    """Return whether `shorten_wait` would not change the port."""
    before = path.read_bytes()
    number = struct.pack('<I', int(path.name.removeprefix('fastrtps_port')))
    place = before.find(number)
    while place >= 0:
        check, wait = struct.unpack_from('<II', before, place + 8)
        if 30 <= check <= 600_000 and wait in (check // 3, WAIT_MS):
            return wait == WAIT_MS
        place = before.find(number, place + 1)
    raise AssertionError(f'{path} has another layout')
