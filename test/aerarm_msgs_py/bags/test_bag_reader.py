import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py.bags.bag import RecordedMessage
from aerarm_msgs_py.bags.bag_reader import BagError, BagWarning, read_joint_states, topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr


def joint_states(*payloads: bytes) -> list[RecordedMessage]:
    return [RecordedMessage(0, payload, 10 + k, 10, k + 1) for k, payload in enumerate(payloads)]


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_reads_every_number_back(write_bag, recording, compression: str) -> None:
    directory = write_bag(recording.messages(3000), compression=compression)
    series = read_joint_states(directory)
    assert series.names == recording.names
    assert len(series) == 3000
    values = np.stack([series.position, series.velocity, series.effort], axis=1)
    np.testing.assert_array_equal(values, recording.numbers(3000))
    stamp_ns = recording.start_ns + recording.period_ns * np.arange(3000)
    np.testing.assert_allclose(series.stamp, stamp_ns / 1e9, rtol=0, atol=3e-7)
    np.testing.assert_allclose(series.log_time - series.stamp, 50e-6, atol=1e-6)
    np.testing.assert_array_equal(series.sequence, np.arange(1, 3001))
    motor = read_joint_states(directory, 'motor_states')
    np.testing.assert_array_equal(motor.velocity, 10 * series.velocity)


def test_joints_go_by_name_when_their_order_or_number_changes(write_bag) -> None:
    ab, ba, c = JointStateCdr(['a', 'b']), JointStateCdr(['b', 'a']), JointStateCdr(['c'], 'frame')
    payloads = (
        ab.pack(0, [1, 2], None, [3, 4]),
        ba.pack(1, [20, 10]),
        c.pack(2, None, [7]),
        ab.pack(3, [5, 6]),
    )
    series = read_joint_states(write_bag(joint_states(*payloads)))
    nan = np.nan
    assert series.names == ('a', 'b', 'c')
    expected = [[1, 2, nan], [10, 20, nan], [nan, nan, nan], [5, 6, nan]]
    np.testing.assert_array_equal(series.position, expected)
    np.testing.assert_array_equal(series.velocity[2], [nan, nan, 7])
    np.testing.assert_array_equal(series.effort[:2], [[3, 4, nan], [nan, nan, nan]])


def test_columns_by_name(write_bag, recording) -> None:
    series = read_joint_states(write_bag())
    part = series.columns(['joint3', 'joint1'])
    np.testing.assert_array_equal(part.effort, series.effort[:, [2, 0]])
    with pytest.raises(KeyError, match="'elbow'"):
        series.columns(['joint1', 'elbow'])


def test_a_field_of_another_length_is_left_out_with_a_warning(write_bag) -> None:
    message = JointState(name=['a', 'b'], position=[1.0, 2.0], velocity=[1.0])
    directory = write_bag(joint_states(serialize_message(message)))
    with pytest.warns(BagWarning, match='topic /joint_states of .*: 1 fields do not have'):
        series = read_joint_states(directory)
    np.testing.assert_array_equal(series.position, [[1.0, 2.0]])
    assert np.isnan(series.velocity).all()


def test_counts_messages_and_losses(write_bag, recording) -> None:
    messages = recording.messages(500)
    del messages[200:211]  # six joint states, five motor states
    found = topics(write_bag(messages))
    assert found['/joint_states'].messages == 494
    assert found['/joint_states'].lost == 6
    assert found['/motor_states'].lost == 5
    assert (found['/arm_mode'].messages, found['/arm_mode'].lost) == (0, None)
    assert found['/arm_mode'].type == 'std_msgs/msg/String'


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_a_cut_file_is_read_to_its_end(write_bag, recording, compression) -> None:
    file = write_bag(recording.messages(5000), compression=compression) / 'bag_0.mcap'
    content = file.read_bytes()
    for share in (0.3, 0.6, 0.95):
        file.write_bytes(content[: int(share * len(content))])
        with pytest.warns(BagWarning, match='is cut off'):
            series = read_joint_states(file)
        assert len(series) > 1000 * share
        np.testing.assert_array_equal(series.effort, recording.numbers(5000)[: len(series), 2])


def test_a_damaged_chunk_is_left_out_with_a_warning(write_bag, recording) -> None:
    file = write_bag(recording.messages(8000)) / 'bag_0.mcap'
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(content)
    with pytest.warns(BagWarning, match='the chunk at byte .* is damaged and ignored'):
        series = read_joint_states(file)
    assert 1000 < len(series) < 8000
    numbers = recording.numbers(8000)
    np.testing.assert_array_equal(series.effort, numbers[series.sequence - 1, 2])


def test_a_bag_may_have_several_files(write_bag, recording) -> None:
    whole = write_bag(recording.messages(50), 'whole')
    for k in (1, 2, 10):
        part = write_bag(recording.messages(50, first=50 * k), f'part_{k}')
        shutil.copy(part / f'part_{k}_0.mcap', whole / f'whole_{k}.mcap')
    series = read_joint_states(whole)
    assert [series.sequence[50 * k] for k in range(4)] == [1, 51, 101, 501]


def test_metadata_is_not_needed(write_bag) -> None:
    directory = write_bag()
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        expected = read_joint_states(directory).stamp
    (directory / 'metadata.yaml').write_text('rosbag2_bagfile_information: [broken')
    np.testing.assert_array_equal(read_joint_states(directory).stamp, expected)
    (directory / 'metadata.yaml').unlink()
    np.testing.assert_array_equal(read_joint_states(directory).stamp, expected)
    np.testing.assert_array_equal(read_joint_states(directory / 'bag_0.mcap').stamp, expected)


def test_a_wrong_path_raises_an_error_with_the_reason(tmp_path: Path, write_bag) -> None:
    with pytest.raises(BagError, match='bag .*does not exist'):
        read_joint_states(tmp_path / 'missing')
    with pytest.raises(BagError, match='is not a bag'):
        read_joint_states(tmp_path)
    text = tmp_path / 'notes.mcap'
    text.write_text('notes')
    with pytest.raises(BagError, match='is not an MCAP file'):
        read_joint_states(text)
    text.write_bytes(b'')
    with pytest.raises(BagError, match='is empty: record or copy'):
        read_joint_states(text)
    with pytest.raises(BagError, match="pass the bag's directory"):
        read_joint_states(write_bag() / 'metadata.yaml')


def test_repeated_joint_names_raise_an_error(write_bag) -> None:
    message = JointState(name=['a', 'b', 'a'], position=[1.0, 2.0, 3.0])
    directory = write_bag(joint_states(serialize_message(message)))
    with pytest.raises(BagError, match='names joint a more than once: check the joint names'):
        read_joint_states(directory)


def test_a_missing_or_empty_topic_raises_an_error(write_bag) -> None:
    directory = write_bag([*joint_states(JointStateCdr(['a']).pack(0, [1.0])),
                           RecordedMessage(2, b'\0\1\0\0\1\0\0\0\0', 1, 1, 1)])  # fmt: skip
    with pytest.raises(
        BagError, match=r'no topic /states: choose one of /arm_mode \(std_msgs/msg/String'
    ):
        read_joint_states(directory, '/states')
    with pytest.raises(BagError, match='contains no messages of topic /motor_states'):
        read_joint_states(directory, '/motor_states')
    with pytest.raises(BagError, match='has the type std_msgs/msg/String'):
        read_joint_states(directory, '/arm_mode')


def test_an_undecodable_message_raises_an_error(write_bag) -> None:
    directory = write_bag(joint_states(b'\0\1\0\0' + b'\xff' * 40))
    with pytest.raises(BagError, match='cannot be decoded'):
        read_joint_states(directory)
