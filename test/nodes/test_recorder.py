"""The recorder as a separate process, over real DDS."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from quick_spinning import spin_once, spin_until
from rclpy.node import Node
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64MultiArray, String

from aerarm_msgs_py import topics as names
from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.sequence_gaps import lost_messages
from aerarm_msgs_py.storage.read_limits import BagWarning
from aerarm_msgs_py.topics import Topic
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.process.node_process import NodeProcess, ros_environment

JOINTS = ('joint1', 'joint2', 'joint3', 'joint4')
STREAMS = (names.JOINT_STATES, names.MOTOR_STATES, names.JOINT_COMMAND)
PATIENCE = 300.0  # [s] of the host, which may be busy


class Source:
    """Publish the arm's topics, and receive the recorder's status."""

    def __init__(self, node: Node, prefix: str = '') -> None:
        self._node = node
        self._cdr, self._power_cdr = JointStateCdr(JOINTS), Float64ArrayCdr(4)
        self.streams = [self._publisher(topic, prefix) for topic in STREAMS]
        self.power = self._publisher(names.MOTOR_POWER, prefix)
        self.mode = self._publisher(names.ARM_MODE, prefix)
        self.diagnostics = self._publisher(names.DIAGNOSTICS)
        self.statuses: list[dict] = []
        status = names.RECORDER_STATUS
        node.create_subscription(
            String,
            prefix + status.name,
            lambda message: self.statuses.append(json.loads(message.data)),
            status.qos,
        )

    def wait_for(self, condition: Callable[[dict], bool]) -> None:
        """Spin until a status fulfils a condition."""
        deadline = time.monotonic() + PATIENCE
        while not any(condition(status) for status in self.statuses):
            assert time.monotonic() < deadline, self.statuses
            spin_once(self._node, 0.1)

    def wait_until_matched(self, count: int) -> None:
        """Wait until the recorder has found the publishers of so many topics."""
        self.wait_for(lambda status: len(status['matched']) >= count)

    def stream(self, count: int) -> np.ndarray:
        """Publish four topics `count` times at 1 kHz; return the (count, 3, 4) numbers."""
        values = np.random.default_rng(1).normal(size=(count, 3, 4))
        loop = PeriodicLoop(1e-3)

        def cycle(now_ns: int, index: int) -> None:
            payload = self._cdr.pack(time.time_ns(), *values[loop.cycles])
            for publisher in self.streams:
                publisher.publish(payload)
            self.power.publish(self._power_cdr.pack(values[loop.cycles, 0]))
            if loop.cycles == count - 1:
                loop.stop()

        loop.run(cycle)
        # The recorder takes messages in batches; an acknowledged one is behind all of these.
        self.mode.publish(String(data='ready'))
        assert self.mode.wait_for_all_acked()
        time.sleep(0.2)
        return values

    def _publisher(self, topic: Topic, prefix: str = ''):
        return self._node.create_publisher(topic.type, prefix + topic.name, topic.qos)


@pytest.fixture
def start(tmp_path: Path, ros_domain: dict[str, str]):
    """Return a function that starts a recorder; it is stopped at the end of the test."""
    started: list[NodeProcess] = []

    def start(*arguments: str, **parameters: object) -> NodeProcess:
        parameters.setdefault('bag', tmp_path / 'bag')
        started.append(
            NodeProcess('recorder', arguments, parameters, ros_domain, tmp_path / 'log.txt')
        )
        return started[-1]

    yield start
    for process in started:
        process.stop(signal.SIGKILL)


@pytest.fixture
def source(ros_node: Node) -> Source:
    return Source(ros_node)


def counts(bag: Path) -> dict[str, tuple[int, int | None]]:
    """Return the numbers of messages and of lost messages of each topic in a bag."""
    numbers: dict[str, list[int]] = {}
    for block in Bag(bag).blocks():
        numbers.setdefault(block.topic, []).extend(block.sequence.tolist())
    return {topic: (len(x), lost_messages(x)) for topic, x in numbers.items()}


def test_records_four_topics_at_1_khz_without_a_loss_and_publishes_its_status(
    start, source, ros_node, tmp_path
) -> None:
    source.mode.publish(String(data='idle'))  # before anybody listens
    # Several publishers of one topic, each of which has published another number of messages.
    topic = names.DIAGNOSTICS
    others = [ros_node.create_publisher(topic.type, topic.name, topic.qos) for _ in range(4)]
    for index, publisher in enumerate(others):
        for _ in range(40 * index):
            publisher.publish(DiagnosticArray())
    recorder = start()
    source.wait_until_matched(6)
    source.wait_for(lambda status: status['state'] == 'recording')
    values = source.stream(1000)
    for turn in range(8):
        for publisher in others[turn % 2 :]:
            publisher.publish(DiagnosticArray())
    assert all(publisher.wait_for_all_acked() for publisher in others)
    time.sleep(0.2)
    assert recorder.stop(signal.SIGINT) == 0, recorder.tail()
    found = counts(tmp_path / 'bag')
    for topic in ('/joint_states', '/motor_states', '/joint_command', '/motor_power'):
        assert found[topic] == (1000, 0)
    assert found['/arm_mode'][0] == 2
    diagnostics, lost = found['/diagnostics']
    assert diagnostics >= 8 * 4 - 4 + 1  # and its own
    assert lost == 0
    series = read_joint_states(tmp_path / 'bag')
    np.testing.assert_array_equal(series.effort, values[:, 2])
    assert (np.diff(series.log_time) >= 0).all()
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 4 * 1000 + 2 + diagnostics
    log = recorder.tail(30)
    assert '/joint_states: 1000 messages, 0 lost' in log
    assert f'{tmp_path / "bag"}: {4002 + diagnostics} messages, 0 lost' in log
    assert 'publishers found: ' in log
    source.wait_for(lambda status: status['state'] == 'stored')
    assert source.statuses[-1]['bag'] == str(tmp_path / 'bag')


def test_only_requested_topics_of_its_namespace_are_recorded(start, ros_node, tmp_path) -> None:
    source = Source(ros_node, '/left/')
    own = ros_node.create_publisher(Float64MultiArray, '/left/own', 10)
    recorder = start(
        *('--ros-args', '-r', '__ns:=/left', '--'),
        topics=['joint_states', 'own=std_msgs/msg/Float64MultiArray'],
        compression='lz4',
    )
    source.wait_until_matched(2)
    own.publish(Float64MultiArray(data=[1.0]))
    source.stream(20)
    assert recorder.stop() == 0
    found = {topic: count for topic, (count, _) in counts(tmp_path / 'bag').items()}
    assert found == {'/left/joint_states': 20, '/left/own': 1}


def test_a_bag_that_cannot_be_created_is_one_line(start, tmp_path) -> None:
    (tmp_path / 'bag').mkdir()
    recorder = start()
    assert recorder.wait(PATIENCE) == 1
    log = recorder.tail()
    assert log.startswith('recorder: ')
    assert 'already exists: choose another directory' in log
    assert log.count('\n') == 0
    assert not any((tmp_path / 'bag').iterdir())


def test_a_disk_that_is_full_ends_it_with_one_line_and_a_readable_bag(
    source, ros_domain, tmp_path
) -> None:
    bag, log = tmp_path / 'bag', tmp_path / 'log.txt'
    limited = f'ulimit -f 128 && exec {sys.executable} -m aerarm_ros.executables recorder "$@"'
    arguments = ['--ros-args', '-p', f'bag:={bag}', '-p', 'compression:=none']
    with (
        log.open('w') as stream,
        subprocess.Popen(
            ['bash', '-c', limited, 'recorder', *arguments],
            env=ros_environment(ros_domain),
            stdout=stream,
            stderr=stream,
        ) as recorder,
    ):
        source.wait_until_matched(6)
        source.stream(1000)
        assert recorder.wait(PATIENCE) == 1
    source.wait_for(lambda status: status['state'] == 'failed')
    text = log.read_text()
    assert text.count('cannot be written (File too large)') == 1
    assert 'Traceback' not in text
    with pytest.warns(BagWarning):
        assert counts(bag)['/joint_states'][0] > 10


def test_lost_messages_silent_streams_and_unrecordable_publishers_are_reported(
    start, source, ros_node
) -> None:
    ros_node.create_publisher(String, 'imu', 10)
    ros_node.create_publisher(String, 'plan_status', names.NEWEST)
    found: list[DiagnosticStatus] = []
    topic = names.DIAGNOSTICS
    topic.subscription(
        ros_node, lambda message: found.extend(s for s in message.status if 'recorder' in s.name)
    )
    recorder = start(depth=10)
    source.wait_until_matched(6)

    def reported(key: str) -> str:
        """Return a value of the recorder's newest diagnostics."""
        return next((item.value for item in found[-1].values if item.key == key), '')

    def wait(condition: Callable[[], object]) -> None:
        assert spin_until(ros_node, lambda: found and condition(), PATIENCE), found[-1:]

    payload = JointStateCdr(JOINTS).pack(1, [0.0] * 4)
    source.streams[0].publish(payload)
    silent = '/motor_states, /motor_power, /joint_command'
    wait(lambda: reported('topics without a message') == silent)
    assert found[-1].name == '/recorder: recorder'
    assert reported('messages lost') == 'at least 0'
    assert int(reported('bytes written')) > 1000
    other = rclpy.create_node('other_bridge')
    topic = names.JOINT_STATES
    other.create_publisher(topic.type, topic.name, topic.qos)
    for text in (
        '/joint_states has 2 publishers, /other_bridge and /test: stop all',
        '/imu of /test is not recorded: its type is std_msgs/msg/String',
        '/plan_status of /test is not recorded: its quality of service is',
    ):
        wait(lambda text=text: text in recorder.tail(50))
    other.destroy_node()
    for _ in range(3000):  # more at once than may wait
        source.streams[0].publish(payload)
    wait(lambda: 'messages of /joint_states' in found[-1].message)
    assert found[-1].level == DiagnosticStatus.WARN
    assert int(reported('messages lost').removeprefix('at least ')) > 0
    # The console says so while it happens, and what to do.
    wait(lambda: ' of /joint_states, from ' in recorder.tail(50))
    assert 'cause: processor: this computer was too busy' in recorder.tail(100)
    assert 'parameter depth, 10 now' in recorder.tail(100)
    wait(lambda: '(cause of the last loss: processor)' in found[-1].message)
    assert recorder.stop() == 0
    log = recorder.tail(100)
    (line,) = [x for x in log.splitlines() if ' messages, ' in x and '/joint_states: ' in x]
    assert '[WARN]' in line
    assert log.count('/imu of /test') == 1
    assert '/motor_states: 0 messages, because the publisher sent none' in log
