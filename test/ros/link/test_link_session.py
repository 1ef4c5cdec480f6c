"""The drone's and the ground's end: addresses and keys."""

import contextlib
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

import pytest
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.link.connection import Connection, Received
from aerarm_ros.nodes.ground_link import PARAMETERS
from aerarm_ros.ros.link.link_ends import DroneEnd, GroundEnd, LinkEnd

KEY, OTHER_KEY = bytes(range(32)), bytes(32)


class Ground:
    """A connection of a ground with a socket of its own."""

    def __init__(self, key: bytes = KEY) -> None:
        self.connection = Connection(key, 'ground', 'drone', 9_000.0)
        self.socket = udp()
        self.received = 0
        self.sent: list[bytes] = []

    def exchange(self, port: int) -> None:
        """Send a datagram and process what has arrived."""
        now_ns = time.monotonic_ns()
        clocks = 1e-9 * now_ns, now_ns, time.time_ns()
        self.sent.append(self.connection.datagram(*clocks))
        self.socket.sendto(self.sent[-1], ('127.0.0.1', port))
        for datagram in waiting_in(self.socket):
            self.received += 1
            self.connection.receive(datagram, *clocks)
            if self.connection.answer is not None:
                self.socket.sendto(self.connection.answer, ('127.0.0.1', port))


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
def values(ros_node: Node, port: int, tmp_path: Path) -> SimpleNamespace:
    given = PARAMETERS.declare(ros_node)
    given.address = given.drone = '127.0.0.1'
    given.port, given.bags = port, str(tmp_path)
    return given


@pytest.fixture
def port() -> int:
    with contextlib.closing(udp()) as free:
        return int(free.getsockname()[1])


@pytest.fixture
def drone(ros_node: Node, values: SimpleNamespace) -> Iterator[DroneEnd]:
    end = DroneEnd(ros_node, values, KEY)
    yield end
    end.close()


def run(until: Callable[[], object], *steps: Callable[[], None]) -> None:
    deadline = time.monotonic() + 10.0
    while not until():
        assert time.monotonic() < deadline
        for step in steps:
            step()


def test_recorded_datagrams_from_another_address_move_nothing(drone: DroneEnd, port: int) -> None:
    ground, attacker = Ground(), udp()

    def exchange() -> None:
        ground.exchange(port)

    run(lambda: ground.received > 20, exchange, drone.step)
    starts = [Ground().connection.datagram(0.0, 0, 0) for _ in range(20)]
    for datagram in [*starts, *ground.sent]:
        attacker.sendto(datagram, ('127.0.0.1', port))
    before = ground.received
    run(lambda: ground.received > before + 20, exchange, drone.step)
    stolen = list(waiting_in(attacker))
    assert len(stolen) <= 20  # at most one short answer to each recorded start
    assert all(len(datagram) == 40 for datagram in stolen)
    assert drone.connection.peers == 1


def test_a_ground_that_changes_its_address_keeps_the_connection(drone: DroneEnd, port: int) -> None:
    ground = Ground()

    def exchange() -> None:
        ground.exchange(port)

    run(lambda: ground.received > 5, exchange, drone.step)
    ground.socket, before = udp(), ground.received
    run(lambda: ground.received > before + 5, exchange, drone.step)
    assert drone.connection.peers == 1


def test_two_grounds_are_reported(drone: DroneEnd, port: int) -> None:
    grounds = Ground(), Ground()

    def exchange() -> None:
        for ground in grounds:
            ground.exchange(port)

    assert 'one ground' not in drone._usual_problem(time.monotonic())
    run(lambda: 'one ground' in drone._usual_problem(time.monotonic()), exchange, drone.step)
    assert drone.connection.peers == 3
    assert 'one ground' not in drone._usual_problem(time.monotonic() + 20.0)


def test_a_wrong_key_is_reported_once_on_both_hosts(
    drone: DroneEnd, ros_node: Node, values: SimpleNamespace, capfd: pytest.CaptureFixture[str]
) -> None:
    ground = GroundEnd(ros_node, values, OTHER_KEY)
    ends: tuple[LinkEnd, LinkEnd] = (drone, ground)
    try:
        run(lambda: all(end._key_problem for end in ends), drone.step, ground.step)
        begin = time.monotonic()
        run(lambda: time.monotonic() > begin + 1.5, drone.step, ground.step)
    finally:
        ground.close()
    lines = [line for line in capfd.readouterr().err.splitlines() if 'the key of' in line]
    assert len(lines) == 2
    for line in lines:
        assert "copy the drone's key file to the ground" in line
    for end in ends:
        assert 'differs from the key of this host' in end._usual_problem(time.monotonic())


def test_strangers_do_not_blame_the_key_of_a_live_ground(drone: DroneEnd, port: int) -> None:
    ground, stranger = Ground(), Ground(OTHER_KEY)

    def exchange() -> None:
        ground.exchange(port)

    run(lambda: ground.received > 20, exchange, drone.step)
    before = ground.received
    run(
        lambda: ground.received > before + 20,
        *(exchange, lambda: stranger.exchange(port), drone.step),
    )
    assert drone._key_problem == ''
    assert stranger.received == 0


@pytest.mark.parametrize('stray', [b'x' * 60, bytes(range(1, 120)), bytes(100)])
def test_a_datagram_of_another_protocol_does_not_blame_the_key(
    drone: DroneEnd, port: int, stray: bytes
) -> None:
    sender = udp()
    sender.sendto(stray, ('127.0.0.1', port))
    run(lambda: drone.connection.rejected, drone.step)
    assert drone._key_problem == ''


def test_the_newest_address_with_another_key_is_named(drone: DroneEnd) -> None:
    datagram = Connection(OTHER_KEY, 'ground', 'drone', 9_000.0).datagram(0.0, 0, 0)
    for address in ('10.0.0.1', '10.0.0.2'):
        drone._on_rejected(datagram, (address, 7))
        assert f'the key of {address} differs' in drone._usual_problem(time.monotonic())


def test_both_ends_have_statuses_of_different_names(
    drone: DroneEnd, ros_node: Node, values: SimpleNamespace
) -> None:
    ground = GroundEnd(ros_node, values, KEY)
    came: set[str] = set()
    topic = topics.DIAGNOSTICS
    ros_node.create_subscription(
        topic.type, topic.name, lambda m: came.update(s.name for s in m.status), topic.qos
    )

    def spin() -> None:
        rclpy.spin_once(ros_node, timeout_sec=0.0)

    run(lambda: len(came) > 1, drone.step, ground.step, spin)
    node = ros_node.get_fully_qualified_name()
    assert came == {f'{node}: drone side', f'{node}: ground side'}
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
def test_random_messages_of_an_authentic_end_do_not_end_the_node(
    ros_node: Node, values: SimpleNamespace, role: str
) -> None:
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
