"""Recordings of the drone, requested and fetched over two connections in one process."""

import json
import os
import random
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from bad_link import same
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.bags.bag_writer import BagWriter, RecordedTopic
from aerarm_ros.link.connection import Connection
from aerarm_ros.ros.link.recordings import (
    BAG_REPORTS,
    BAG_REQUESTS,
    BLOCKS,
    FETCHING,
    FINISH,
    QUESTIONS,
    WAITING,
    DroneRecordings,
    GroundRecordings,
)
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.recording_request import RecordingRequest

KEY = bytes(range(32))
TICK = 0.02  # [s]


class LinkedRecordings:
    """Both ends of recordings, joined by a radio that loses datagrams, in a thread."""

    def __init__(self, node: Node, folder: Path) -> None:
        self.loss, self.is_cut, self.is_over = 0.0, False, False
        self.spy: list[tuple[str, bytes]] = []
        self.lock = threading.RLock()
        self.publishes = False
        self.errors: list[Exception] = []
        self._node = node
        self._values = SimpleNamespace(bags=str(folder), fetch_rate=50.0)
        self._random = random.Random(9)
        self._sent = 0.0
        kind = topics.JOINT_STATES
        self._states = node.create_publisher(kind.type, kind.name, kind.offered)
        self.start_drone()
        self.start_ground()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def start_drone(self) -> None:
        self.to_ground = Connection(KEY, 'drone', 'ground', 26_000.0)
        self.drone = DroneRecordings(self._node, self.to_ground, self._values)

    def start_ground(self) -> None:
        self.to_drone = Connection(KEY, 'ground', 'drone', 9_000.0)
        self.ground = GroundRecordings(self._node, self.to_drone, self._values)

    def restart_drone(self) -> None:
        with self.lock:
            self.drone.close()
            self.start_drone()

    def restart_ground(self) -> None:
        with self.lock:
            self.ground.close()
            self.start_ground()

    def close(self) -> None:
        self.is_over = True
        self._thread.join()
        self.drone.close()
        self.ground.close()
        assert self.errors == []
        assert self.drone._logs is None or not self.drone._logs.exists()

    def receive(self, side: str, datagram: bytes) -> None:
        """Process a datagram as the end of a side does."""
        takers = {
            BAG_REQUESTS: self.drone.take_request,
            QUESTIONS: self.drone.take_question,
            BAG_REPORTS: self.ground.take_report,
            BLOCKS: self.ground.take_block,
        }
        connection = self.to_ground if side == 'drone' else self.to_drone
        now_ns = time.monotonic_ns()
        for received in connection.receive(datagram, 1e-9 * now_ns, now_ns, time.time_ns()):
            takers[received.channel](received.payload)
        if connection.answer is not None:
            self._transmit('ground' if side == 'drone' else 'drone', connection.answer)

    def _run(self) -> None:
        while not self.is_over:
            with self.lock:
                try:
                    self._step()
                except Exception as error:  # must fail the test, not end the thread silently
                    self.errors.append(error)
                    return
            time.sleep(0.002)

    def _step(self) -> None:
        now_ns = time.monotonic_ns()
        now = 1e-9 * now_ns
        self.drone.update(now, self.to_ground.last_received)
        self.drone.send(self._send_block)
        is_due = now - self._sent >= TICK
        self.ground.update(now, is_due)
        if is_due:
            self._sent = now
            self._transmit('ground', self.to_ground.datagram(now, now_ns, time.time_ns()))
            self._transmit('drone', self.to_drone.datagram(now, now_ns, time.time_ns()))
            if self.publishes:
                state = JointState(name=['joint1'], position=[0.0])
                state.header.stamp = Time(nanoseconds=now_ns).to_msg()
                self._states.publish(state)

    def _send_block(self, datagram: bytes) -> bool:
        self._transmit('ground', datagram)
        return True

    def _transmit(self, side: str, datagram: bytes) -> None:
        self.spy.append((side, datagram))
        if not self.is_cut and self._random.random() >= self.loss:
            self.receive(side, datagram)


@pytest.fixture
def link(ros_node: Node, tmp_path: Path) -> Iterator[LinkedRecordings]:
    (tmp_path / 'bags').mkdir()
    link = LinkedRecordings(ros_node, tmp_path / 'bags')
    yield link
    link.close()


@pytest.fixture
def client(link: LinkedRecordings) -> Iterator[Node]:
    node = rclpy.create_node('client')
    yield node
    node.destroy_node()


def make_bag(folder: Path, name: str = 'flight', blocks: int = 150) -> Path:
    bag = folder / 'bags' / name
    bag.mkdir()
    (bag / f'{name}_0.mcap').write_bytes(random.Random(7).randbytes(1024 * blocks + 5))
    (bag / 'metadata.yaml').write_text('rosbag2_bagfile_information:')
    return bag


def request(
    client: Node, folder: Path, name: str = 'flight', tell: Callable[[str], None] = lambda _: None
) -> RecordingRequest:
    return RecordingRequest(client, name, folder / name, tell)


def when(condition: Callable[[], object], act: Callable[[], None]) -> threading.Thread:
    """Act in another thread as soon as a condition holds."""

    def wait() -> None:
        deadline = time.monotonic() + 20.0
        while not condition() and time.monotonic() < deadline:
            time.sleep(0.002)
        act()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def is_half_way(link: LinkedRecordings) -> Callable[[], bool]:
    def check() -> bool:
        with link.lock:
            fetch = link.ground._fetch
            return fetch is not None and fetch.stored > 0.3 * fetch.size

    return check


def test_a_fetch_over_a_lossy_radio_resumes_after_a_restart_of_the_ground(
    link: LinkedRecordings, client: Node, tmp_path: Path
) -> None:
    bag = make_bag(tmp_path)
    link.loss = 0.1
    thread = when(is_half_way(link), link.restart_ground)
    request(client, tmp_path / 'here').fetch()
    thread.join()
    assert same(bag, tmp_path / 'here' / 'flight')
    blocks = sum(len(datagram) > 1000 for side, datagram in link.spy if side == 'ground')
    assert blocks < 1.7 * 151  # what was stored is not sent again


def test_a_fetch_continues_without_the_user_and_after_a_restart_of_the_drone(
    link: LinkedRecordings, client: Node, tmp_path: Path
) -> None:
    bag = make_bag(tmp_path)
    first = request(client, tmp_path / 'here')
    thread = when(is_half_way(link), first._stop)
    first._begin()
    first._ask_until(FINISH, (FETCHING,), inf)
    thread.join()
    link.restart_drone()
    deadline = time.monotonic() + 10.0
    while not (tmp_path / 'here' / 'flight' / 'metadata.yaml').exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert same(bag, tmp_path / 'here' / 'flight')


def test_a_fetch_that_is_rejected_names_the_reason_and_can_be_repeated(
    link: LinkedRecordings, client: Node, tmp_path: Path
) -> None:
    def fetch(folder: str) -> None:
        request(client, tmp_path / folder).fetch()

    with pytest.raises(ArmClientError, match='the drone has no bag flight'):
        fetch('here')
    bag = tmp_path / 'bags' / 'flight'
    writer = BagWriter(bag, [RecordedTopic('/joint_states', 'sensor_msgs/msg/JointState')])
    with pytest.raises(ArmClientError, match='still recording flight'):
        fetch('here')
    writer.close()
    fetch('here')
    assert same(bag, tmp_path / 'here' / 'flight')
    (tmp_path / 'here' / 'flight' / 'flight_0.mcap').write_text('another')
    with pytest.raises(ArmClientError, match='belongs to another recording'):
        fetch('here')
    fetch('there')
    assert same(bag, tmp_path / 'there' / 'flight')
    with link.lock:
        shutil.rmtree(bag)
        make_bag(tmp_path)
    thread = when(is_half_way(link), (bag / 'metadata.yaml').unlink)
    with pytest.raises(ArmClientError, match='the drone cannot read the bag flight'):
        fetch('elsewhere')
    thread.join()


def test_a_second_bag_waits_for_the_first(link, client, tmp_path, monkeypatch) -> None:
    bags = [make_bag(tmp_path, name) for name in ('one', 'two')]
    second = request(client, tmp_path / 'here', 'two')
    second._begin()
    states: list[tuple[object, object]] = []
    publish = link.ground._publish

    def note(ids: list[str], state: dict[str, object]) -> None:
        states.append((state['name'], state['state']))
        publish(ids, state)

    monkeypatch.setattr(link.ground, '_publish', note)
    thread = when(is_half_way(link), lambda: second._ask(FINISH))
    request(client, tmp_path / 'here', 'one').fetch()
    thread.join()
    assert ('two', WAITING) in states
    assert same(bags[0], tmp_path / 'here' / 'one')
    second.fetch()
    assert same(bags[1], tmp_path / 'here' / 'two')


def record(
    link: LinkedRecordings, client: Node, folder: Path, then: Callable[[RecordingRequest], None]
) -> list[str]:
    """Record until something happens after the start, and return what the user reads."""
    told: list[str] = []
    threads: list[threading.Thread] = []
    link.publishes = True

    def tell(text: str) -> None:
        told.append(text)
        if 'Ctrl-C ends the recording' in text:
            threads.append(when(lambda: True, lambda: (time.sleep(0.3), then(made))[0]))

    made = request(client, folder, tell=tell)
    try:
        made.record()
    finally:
        for thread in threads:
            thread.join()
    return told


def test_a_recording_of_the_drone_is_fetched_after_ctrl_c(link, client, tmp_path) -> None:
    link.loss = 0.05
    record(link, client, tmp_path / 'here', RecordingRequest._stop)
    assert same(tmp_path / 'bags' / 'flight', tmp_path / 'here' / 'flight')
    assert len(read_joint_states(tmp_path / 'here' / 'flight')) > 5


def end_recorder(link: LinkedRecordings) -> None:
    process = link.drone._process
    assert process is not None
    os.kill(process.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ('end', 'said'),
    [
        (end_recorder, 'ended before Ctrl-C: .*status -9.*flight contains'),
        (LinkedRecordings.restart_drone, 'restarted during the recording'),
    ],
)
def test_the_user_learns_why_the_recording_ended_early(link, client, tmp_path, end, said) -> None:
    with pytest.raises(ArmClientError, match=said):
        record(link, client, tmp_path / 'here', lambda _: end(link))
    assert same(tmp_path / 'bags' / 'flight', tmp_path / 'here' / 'flight')


def test_an_invalid_request_is_rejected(link: LinkedRecordings, tmp_path: Path) -> None:
    for name, do, problem in (
        ('../x', 'record', 'no valid bag name'),
        ('../x', 'finish', 'no valid bag name'),
        ('flight', 'fly', "does not know the request 'fly'"),
    ):
        with link.lock:
            link.drone.take_request(json.dumps({'name': name, 'do': do, 'id': 'a'}).encode())
            assert problem in list(link.to_ground._messages)[-1].payload.decode()
            assert link.drone._process is None
            assert link.drone._served == {}
    assert not list(tmp_path.glob('x*'))


def test_recorded_datagrams_start_nothing(link, client, tmp_path) -> None:
    make_bag(tmp_path, blocks=20)
    request(client, tmp_path / 'here').fetch()
    with link.lock:
        recorded = list(link.spy)
        link.restart_drone()
        link.restart_ground()
        for side, datagram in recorded:
            link.receive(side, datagram)
        assert link.drone._served == {}
    time.sleep(0.3)
    with link.lock:
        for side, datagram in recorded:
            link.receive(side, datagram)
        assert link.to_ground.peers == link.to_drone.peers == 1
        assert link.drone._served == {}
