"""The ends of ground_link, over UDP of this host."""

import contextlib
import functools
import json
import random
import socket
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.link.connection import PROMPT, URGENT, Connection, Received
from aerarm_ros.link.sealed import make_key
from aerarm_ros.nodes.ground_link import PARAMETERS
from aerarm_ros.ros.link.link_ends import DroneEnd, GroundEnd
from aerarm_ros.ros.link.relayed_topics import STOPS, UP_CHANNEL
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.process.shared_ports import WAIT_MS

KEY, OTHER_KEY = bytes(range(32)), bytes(32)


class WatchedEnd(DroneEnd):
    """A drone's end that notes what it processes."""

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        super().__init__(node, values, KEY)
        self.order: list[int] = []

    def _take(self, received: Received) -> None:
        self.order.append(received.channel)
        super()._take(received)


class Ground:
    """A connection of a ground with a socket of its own, to the drone at a port."""

    def __init__(self, port: int, key: bytes = KEY) -> None:
        self.connection = Connection(key, 'ground', 'drone', 1e6)
        self.socket = udp()
        self.received = 0
        self.sent: list[bytes] = []
        self.ahead_ns = 0  # of this host's clock
        self._drone = '127.0.0.1', port

    def send(self) -> None:
        now_ns, system_ns = time.monotonic_ns(), time.time_ns() + self.ahead_ns
        self.sent.append(self.connection.datagram(1e-9 * now_ns, now_ns, system_ns))
        self.socket.sendto(self.sent[-1], self._drone)

    def exchange(self) -> None:
        """Send a datagram and process what has arrived."""
        self.send()
        for datagram in waiting_in(self.socket):
            now_ns = time.monotonic_ns()
            self.received += 1
            self.connection.receive(datagram, 1e-9 * now_ns, now_ns, now_ns)
            if self.connection.answer is not None:
                self.socket.sendto(self.connection.answer, self._drone)


def udp() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(('127.0.0.1', 0))
    made.setblocking(False)
    return made


def waiting_in(source: socket.socket) -> Iterator[bytes]:
    with contextlib.suppress(BlockingIOError):
        while True:
            yield source.recv(2048)


@pytest.fixture
def port() -> int:
    with contextlib.closing(udp()) as free:
        return int(free.getsockname()[1])


@pytest.fixture
def values(ros_node: Node, port: int, tmp_path: Path) -> SimpleNamespace:
    given = PARAMETERS.declare(ros_node)
    given.address = given.drone = '127.0.0.1'
    given.port, given.bags = port, str(tmp_path)
    return given


@pytest.fixture
def drone(ros_node: Node, values: SimpleNamespace) -> Iterator[WatchedEnd]:
    end = WatchedEnd(ros_node, values)
    yield end
    end.close()


def run(until: Callable[[], object], *steps: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not until():
        assert time.monotonic() < deadline
        for step in steps:
            step()


def test_an_e_stop_comes_before_commands_that_arrived_earlier(drone: WatchedEnd, port: int) -> None:
    ground = Ground(port)
    run(lambda: ground.received > 5, ground.exchange, drone.step)
    command = serialize_message(JointState(name=['joint1'], position=[0.0]))
    for priority, channel, payload in (
        *((PROMPT, UP_CHANNEL + 3, command),) * 5,
        (URGENT, STOPS, b'\1\0\0\0\5\0/stop'),
    ):
        ground.connection.send(channel, payload, priority)
        ground.send()
    run(lambda: len(drone.order) >= 6, drone.step)
    assert drone.order == [STOPS, *[UP_CHANNEL + 3] * 5]


@pytest.mark.parametrize(('ahead', 'side'), [(0.0, ''), (30.0, 'ahead of'), (-0.5, 'behind')])
def test_different_clocks_are_reported(
    drone: WatchedEnd, port: int, ahead: float, side: str
) -> None:
    ground = Ground(port)
    ground.ahead_ns = int(1e9 * ahead)
    run(lambda: np.isfinite(drone.connection.clock_offset), ground.exchange, drone.step)
    # The round trip may have been spent in one direction only; 0.1 ms for the clock readings.
    offset = drone.connection.clock_offset
    assert abs(offset - ahead) <= 0.5 * drone.connection.round_trip + 1e-4
    text = drone._usual_problem(time.monotonic())
    assert text == '' if not side else f'{1e3 * abs(offset):.0f} ms {side} this host' in text


def test_a_controller_on_the_ground_is_named(ros_node: Node, values: SimpleNamespace) -> None:
    ground = GroundEnd(ros_node, values, KEY)
    assert ground._problem(0.0) == ''
    other = rclpy.create_node('computed_torque')
    topics.JOINT_COMMAND.publisher(other)
    warning = '/computed_torque cannot command the arm from this host'
    run(lambda: ground._problem(0.0).startswith(warning), lambda: time.sleep(0.01))
    other.destroy_node()
    ground.close()


def test_a_drone_with_an_address_of_its_ground_ignores_others(ros_node, values, port) -> None:
    for address, is_heard in (('127.0.0.2', False), ('127.0.0.1', True)):
        values.ground = address
        end, ground = WatchedEnd(ros_node, values), Ground(port)
        if is_heard:
            run(lambda end=end: end.connection.is_joined, ground.exchange, end.step)
        else:
            run(lambda end=end: end._stranger, ground.exchange, end.step)
            assert 'ground is 127.0.0.2: set ground:=127.0.0.1' in end._usual_problem(0.0)
            assert not end.connection.is_joined
        end.close()
    values.ground = 'no host'
    with pytest.raises(ValueError, match="'no host' in the parameter ground is unknown"):
        WatchedEnd(ros_node, values)


def test_recorded_datagrams_from_another_address_move_nothing(drone: WatchedEnd, port: int) -> None:
    ground, attacker = Ground(port), udp()
    run(lambda: ground.received > 20, ground.exchange, drone.step)
    starts = [Ground(port).connection.datagram(0.0, 0, 0) for _ in range(20)]
    for datagram in [*starts, *ground.sent]:
        attacker.sendto(datagram, ('127.0.0.1', port))
    before = ground.received
    run(lambda: ground.received > before + 20, ground.exchange, drone.step)
    stolen = list(waiting_in(attacker))
    assert len(stolen) <= 20  # at most one short answer to each recorded start
    assert all(len(datagram) == 40 for datagram in stolen)
    # A ground that changes its address keeps the connection.
    ground.socket, before = udp(), ground.received
    run(lambda: ground.received > before + 5, ground.exchange, drone.step)
    assert drone.connection.peers == 1


def test_two_grounds_are_reported(drone: WatchedEnd, port: int) -> None:
    grounds = Ground(port), Ground(port)
    exchanges = [ground.exchange for ground in grounds]
    run(lambda: 'one ground' in drone._usual_problem(time.monotonic()), *exchanges, drone.step)
    assert drone.connection.peers == 3
    assert 'one ground' not in drone._usual_problem(time.monotonic() + 20.0)


def test_a_wrong_key_is_reported_once_unless_a_ground_is_connected(drone, port, capfd) -> None:
    sender, stranger = udp(), Ground(port, OTHER_KEY)
    strays = b'x' * 60, bytes(range(1, 120)), bytes(100)  # of another protocol
    for stray in strays:
        sender.sendto(stray, ('127.0.0.1', port))
    run(lambda: drone.connection.rejected == len(strays), drone.step)
    assert drone._key_problem == ''
    run(lambda: drone.connection.rejected > 100, stranger.exchange, drone.step)
    lines = [line for line in capfd.readouterr().err.splitlines() if 'the key of' in line]
    assert len(lines) == 1
    assert "copy the drone's key file to the ground" in lines[0]
    assert 'differs from the key of this host' in drone._usual_problem(time.monotonic())
    ground = Ground(port)
    run(lambda: ground.received > 5, ground.exchange, drone.step)
    before = ground.received
    run(lambda: ground.received > before + 20, ground.exchange, stranger.exchange, drone.step)
    assert drone._key_problem == ''
    assert stranger.received == 0


def test_both_ends_have_statuses_of_different_names(drone, ros_node, values) -> None:
    names: set[str] = set()
    topics.DIAGNOSTICS.subscription(
        ros_node, lambda message: names.update(status.name for status in message.status)
    )
    ground = GroundEnd(ros_node, values, KEY)
    spin = functools.partial(rclpy.spin_once, ros_node, timeout_sec=0.0)
    run(lambda: len(names) > 1, drone.step, ground.step, spin)
    node = ros_node.get_fully_qualified_name()
    assert names == {f'{node}: drone side', f'{node}: ground side'}
    ground.close()


def random_payload(source: random.Random, names: list[str]) -> bytes:
    """A call of a real service, a JSON object, compressed bytes, or random bytes."""
    name = source.choice(names).encode()
    noise = source.randbytes(source.choice((0, 3, 8, 12, 40, 200)))
    serialized = b'\0\1\0\0' + noise  # the head of a ROS message
    length = len(name) if source.random() < 0.8 else source.randrange(65536)
    keys = ('channel', 'names', 'frame', 'full', 'name', 'id', 'state', 'files', 'number', 'do')
    values = (0, 5, -1, 1e400, None, 'a', ['a', 'a'], {}, 'position', ['position'])
    content = {key: source.choice(values) for key in keys if source.random() < 0.8}
    kinds = ('std_srvs/srv/Trigger', 'std_srvs/srv/SetBool', 'other/srv/Type')
    services = ('/no name', '', '/a/e_stop', '/b', '/\ud800', 'x' * 300)
    offered = {name: source.choice(kinds) for name in services if source.random() < 0.3}
    return source.choice(
        (
            *(noise, serialized, zlib.compress(serialized), json.dumps(content).encode()),
            *(json.dumps([content]).encode(), b'[' * 100_000, json.dumps(offered).encode()),
            struct.pack('<IH', source.randrange(100), length) + name + serialized,
        )
    )


@pytest.mark.parametrize('role', ['drone', 'ground'])
def test_random_messages_of_an_authentic_end_do_not_end_the_node(ros_node, values, role) -> None:
    other = rclpy.create_node('other')  # its services are relayed
    other.create_service(Trigger, '/other/e_stop', lambda _, response: response)
    end = (DroneEnd if role == 'drone' else GroundEnd)(ros_node, values, KEY)
    deadline = time.monotonic() + 0.7
    while time.monotonic() < deadline:
        end.step()
    names = ['/other/set_parameters', '/other/get_parameters', '/other/e_stop', '/test/e_stop']
    source = random.Random(12)
    channels = [*range(45), *range(100, 110), *range(1000, 1012)]
    came: list[Any] = []
    for _ in range(1500):
        came.append(Received(source.choice(channels), random_payload(source, names), False))
    end._receive = lambda: [came.pop() for _ in range(min(50, len(came)))]  # type: ignore[method-assign]
    while came:
        end.step()
    assert end._malformed > 20
    end.close()
    other.destroy_node()


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
