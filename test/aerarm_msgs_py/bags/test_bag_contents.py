"""Several topics of a bag in one pass."""

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_reader import lost_messages, read_contents
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.storage.read_limits import BagError

OTHERS = ('/motor_states', '/arm_mode', '/diagnostics', '/nothing')
COUNT = 2100


def diagnostics(missed: int) -> bytes:
    values = [
        KeyValue(key='period', value='1000'),
        KeyValue(key='missed cycles', value=str(missed)),
    ]
    timing = DiagnosticStatus(name='bridge: timing', level=b'\1', values=values)
    return serialize_message(DiagnosticArray(status=[DiagnosticStatus(name='arm'), timing]))


@pytest.fixture
def bag(tmp_path: Path, recording) -> Path:
    topics = [
        *recording.topics,
        RecordedTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'),
    ]
    first = recording.start_ns
    with BagWriter(tmp_path / 'bag', topics) as writer:
        for message in recording.messages(COUNT):
            writer.write(message)
        for k, mode in ((0, 'ready'), (1000, 'running'), (2000, 'damping')):
            stamp = first + k * recording.period_ns
            text = serialize_message(String(data=mode))
            writer.write(RecordedMessage(2, text, stamp, stamp, 0))
            writer.write(RecordedMessage(3, diagnostics(7 + k // 100), stamp, stamp, 0))
    return tmp_path / 'bag'


def test_every_topic_is_read_by_its_type(bag: Path, recording) -> None:
    contents = read_contents(bag, 'joint_states', OTHERS)
    states, motors = (contents.joint_states[f'/{x}_states'] for x in ('joint', 'motor'))
    np.testing.assert_array_equal(states.velocity, recording.numbers(COUNT)[:, 1])
    np.testing.assert_array_equal(motors.effort, 10.0 * states.effort)
    times, modes = zip(*contents.texts['/arm_mode'], strict=True)
    assert modes == ('ready', 'running', 'damping')
    assert np.diff(times) == pytest.approx(1.0, abs=1e-6)
    assert contents.missed_cycles == 20
    assert contents.expected == COUNT
    assert not contents.damaged
    assert lost_messages(states.sequence) == 0


def test_only_requested_topics_are_returned(bag: Path) -> None:
    contents = read_contents(bag, '/joint_states', most=100)
    assert list(contents.joint_states) == ['/joint_states']
    assert len(contents.joint_states['/joint_states']) == 100
    assert contents.left_out == COUNT - 100
    assert (contents.texts, contents.missed_cycles) == ({}, None)


def test_the_required_topic_must_be_there(bag: Path) -> None:
    with pytest.raises(BagError, match='no topic /nothing'):
        read_contents(bag, '/nothing', OTHERS)
    with pytest.raises(BagError, match='has the type std_msgs/msg/String'):
        read_contents(bag, '/arm_mode')


def test_missing_numbers_are_lost_messages() -> None:
    assert lost_messages(np.array([4, 5, 6])) == 0
    assert lost_messages(np.array([4, 5, 9])) == 3
    assert lost_messages(np.zeros(3, np.int64)) is None
