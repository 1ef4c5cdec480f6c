"""Bags that are incomplete are told from bags whose recorder was killed."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_msgs_py.bag_error import BagError
from aerarm_msgs_py.bag_writer import BagWriter
from aerarm_msgs_py.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.recorded_message import RecordedMessage
from aerarm_msgs_py.recorded_topic import RecordedTopic
from aerarm_ros.identification.recording import JointMapping
from aerarm_ros.nodes.identifier_bags import IdentifierBags

JOINTS = ('a', 'b')
KIND = 'sensor_msgs/msg/JointState'
COUNT = 400


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / 'bag'
    codec = JointStateCdr(JOINTS)
    topics = [RecordedTopic('/arm/joint_states', KIND), RecordedTopic('/arm/joint_command', KIND)]
    with BagWriter(path, topics) as writer:
        for k in range(COUNT):
            stamp = 10**18 + k * 10**7
            angle = np.array([np.sin(0.05 * k), np.cos(0.05 * k)])
            state = codec.pack(stamp, angle, angle, 3.0 * angle)
            writer.write(RecordedMessage(0, state, stamp, stamp, k + 1))
            # A command answers a state; every other one has no velocity.
            command = codec.pack(stamp, None, 2.0 * angle if k % 2 else None, None)
            writer.write(RecordedMessage(1, command, stamp, stamp, k + 1))
    return path


def bags(rename: dict[str, str] | None = None) -> IdentifierBags:
    return IdentifierBags('/arm/joint_states', JOINTS, JointMapping(rename or {}))


def set_count(path: Path, count: int) -> None:
    file = path / 'metadata.yaml'
    document = yaml.safe_load(file.read_text())
    for entry in document['rosbag2_bagfile_information']['topics_with_message_count']:
        entry['message_count'] = count
    file.write_text(yaml.safe_dump(document))


def test_states_and_desired_velocities(bag: Path) -> None:
    reader = bags()
    recording = reader.recording(bag, 'name')
    assert recording.name == 'name'
    assert len(recording.time) == COUNT
    desired = reader.desired(bag, recording)
    assert desired is not None
    assert len(desired.time) == COUNT // 2
    wanted = np.interp(desired.time, recording.time, recording.dq[:, 0])
    assert np.allclose(desired.dq[:, 0], 2.0 * wanted, atol=1e-3)
    assert not reader.messages


def test_less_than_the_metadata_says_is_truncated(bag: Path) -> None:
    set_count(bag, COUNT + 1)
    with pytest.raises(BagError, match=f'truncated: it holds {COUNT} of the {COUNT + 1} messages'):
        bags().recording(bag, 'bag')


@pytest.mark.parametrize('count', [0, COUNT - 50])
def test_a_killed_recorder_leaves_less_in_the_metadata(bag: Path, count: int) -> None:
    set_count(bag, count)
    assert len(bags().recording(bag, 'bag').time) == COUNT


def test_metadata_may_be_missing_or_broken(bag: Path) -> None:
    (bag / 'metadata.yaml').write_text('{')
    assert len(bags().recording(bag, 'bag').time) == COUNT
    (bag / 'metadata.yaml').unlink()
    assert len(bags().recording(bag, 'bag').time) == COUNT


def test_without_commands_nothing_is_desired(bag: Path) -> None:
    recording = bags().recording(bag, 'bag')
    other = IdentifierBags('/other/joint_states', JOINTS, JointMapping({}))
    assert other.desired(bag, recording) is None
