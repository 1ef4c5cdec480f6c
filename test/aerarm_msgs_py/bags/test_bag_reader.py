import shutil
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_reader import (
    BagError,
    BagWarning,
    JointStateBuilder,
    read_contents,
    read_joint_states,
)
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.sequence_gaps import lost_messages
from aerarm_msgs_py.storage.read_limits import MessageBlock

NAN = np.nan


def joint_states(*payloads: bytes) -> list[RecordedMessage]:
    return [RecordedMessage(0, payload, 10 + k, 10, k + 1) for k, payload in enumerate(payloads)]


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_every_number_is_read_also_from_a_cut_file(write_bag, recording, compression: str) -> None:
    directory = write_bag(recording.messages(5000), compression=compression)
    series = read_joint_states(directory)
    assert series.names == recording.names
    values = np.stack([series.position, series.velocity, series.effort], axis=1)
    np.testing.assert_array_equal(values, recording.numbers(5000))
    stamp_ns = recording.start_ns + recording.period_ns * np.arange(5000)
    np.testing.assert_allclose(series.stamp, stamp_ns / 1e9, rtol=0, atol=3e-7)
    np.testing.assert_allclose(series.log_time - series.stamp, 50e-6, atol=1e-6)
    np.testing.assert_array_equal(series.sequence, np.arange(1, 5001))
    part = series.columns(['joint3', 'joint1'])
    np.testing.assert_array_equal(part.effort, series.effort[:, [2, 0]])
    with pytest.raises(KeyError, match="'elbow'"):
        series.columns(['joint1', 'elbow'])
    file = directory / 'bag_0.mcap'
    content = file.read_bytes()
    for share in (0.3, 0.6, 0.95):
        file.write_bytes(content[: int(share * len(content))])
        with pytest.warns(BagWarning, match='is cut off'):
            series = read_joint_states(file)
        assert len(series) > 1000 * share
        np.testing.assert_array_equal(series.effort, values[: len(series), 2])


def diagnostics(missed: int) -> bytes:
    values = [KeyValue(key='missed cycles', value=str(missed))]
    timing = DiagnosticStatus(name='bridge: timing', level=b'\1', values=values)
    return serialize_message(DiagnosticArray(status=[DiagnosticStatus(name='arm'), timing]))


def test_topics_are_read_by_their_types(tmp_path: Path, recording) -> None:
    kind = 'diagnostic_msgs/msg/DiagnosticArray'
    topics = [*recording.topics, RecordedTopic('/diagnostics', kind)]
    messages = recording.messages(2100)
    for k, mode in ((0, 'ready'), (1000, 'running'), (2000, 'damping')):
        stamp = recording.start_ns + k * recording.period_ns
        text = serialize_message(String(data=mode))
        messages.append(RecordedMessage(2, text, stamp, stamp, 0))
        messages.append(RecordedMessage(3, diagnostics(7 + k // 100), stamp, stamp, 0))
    with BagWriter(tmp_path / 'bag', topics) as writer:
        for message in messages:
            writer.write(message)
    others = ('/motor_states', '/arm_mode', '/diagnostics', '/nothing')
    contents = read_contents(tmp_path / 'bag', 'joint_states', others)
    states, motors = (contents.joint_states[f'/{x}_states'] for x in ('joint', 'motor'))
    np.testing.assert_array_equal(motors.effort, 10.0 * states.effort)
    times, modes = zip(*contents.texts['/arm_mode'], strict=True)
    assert modes == ('ready', 'running', 'damping')
    assert np.diff(times) == pytest.approx(1.0, abs=1e-6)
    assert (contents.missed_cycles, contents.expected, contents.damaged) == (20, 2100, False)
    contents = read_contents(tmp_path / 'bag', '/joint_states', most=100)
    assert list(contents.joint_states) == ['/joint_states']
    assert (len(contents.joint_states['/joint_states']), contents.left_out) == (100, 2000)
    assert (contents.texts, contents.missed_cycles) == ({}, None)


def test_missing_numbers_are_lost_messages() -> None:
    for numbers, lost in (
        ([4, 5, 6], 0),
        ([4, 5, 9, 10, 14], 6),
        ([4, 6, 1, 2], 1),  # a restarted publisher
        ([4, 5, 1, 6, 2, 7, 9], 1),
        ([0, 0, 0], None),
        ([2**32 - 1] * 3, None),
        ([], None),
    ):
        assert lost_messages(numbers) == lost


@pytest.mark.parametrize('first', [1, 4000, 900_000])
def test_losses_are_counted_if_several_publishers_share_a_topic(first: int) -> None:
    rng = np.random.default_rng(1)
    streams = [list(range(20_000, 22_000)), list(range(first, first + 2000))]
    mixed = []
    while streams := [stream for stream in streams if stream]:
        mixed.append(streams[rng.integers(len(streams))].pop(0))
    assert lost_messages(mixed) == 0
    del mixed[1000:1010]
    assert lost_messages(mixed) == 10


def test_every_nth_message_of_any_block_is_kept_with_the_joints_of_later_blocks() -> None:
    builder = JointStateBuilder(stride=3)
    for first, last, joint in ((0, 4, 'a'), (4, 5, 'a'), (5, 11, 'b')):
        cdr = JointStateCdr([joint])
        numbers = np.arange(first, last)
        payloads = Payloads.of(cdr.pack(k, [k]) for k in numbers.tolist())
        builder.add(MessageBlock('/x', 'x', numbers, numbers, payloads))
    np.testing.assert_array_equal(
        builder.series().position, [[0, NAN], [3, NAN], [NAN, 6], [NAN, 9]]
    )


def test_joints_go_by_name_when_their_order_or_number_changes(write_bag) -> None:
    ab, ba, c = JointStateCdr(['a', 'b']), JointStateCdr(['b', 'a']), JointStateCdr(['c'], 'frame')
    message = JointState(name=['a', 'b'], position=[8.0, 9.0], velocity=[1.0])
    payloads = (
        ab.pack(0, [1, 2], None, [3, 4]),
        ba.pack(1, [20, 10]),
        c.pack(2, None, [7]),
        ab.pack(3, [5, 6]),
        serialize_message(message),
    )
    bag = write_bag(joint_states(*payloads))
    with pytest.warns(BagWarning, match='topic /joint_states of .*: 1 fields do not have'):
        series = read_joint_states(bag)
    assert series.names == ('a', 'b', 'c')
    expected = [[1, 2, NAN], [10, 20, NAN], [NAN, NAN, NAN], [5, 6, NAN], [8, 9, NAN]]
    np.testing.assert_array_equal(series.position, expected)
    np.testing.assert_array_equal(series.velocity[2:, 2], [7, NAN, NAN])
    np.testing.assert_array_equal(series.effort[:2], [[3, 4, NAN], [NAN, NAN, NAN]])


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


def test_wrong_paths_topics_and_messages_raise_errors_with_the_reason(tmp_path, write_bag) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'notes.mcap').write_text('notes')
    (tmp_path / 'empty.mcap').touch()
    repeated = serialize_message(JointState(name=['a', 'b', 'a'], position=[1.0, 2.0, 3.0]))
    text = RecordedMessage(2, b'\0\1\0\0\1\0\0\0\0', 1, 1, 1)
    bag = write_bag([*joint_states(JointStateCdr(['a']).pack(0, [1.0])), text])
    broken = write_bag(joint_states(b'\0\1\0\0' + b'\xff' * 40), 'broken')
    for path, topic, said in (
        (tmp_path / 'missing', '', 'bag .*does not exist'),
        (tmp_path / 'empty', '', 'is not a bag'),
        (tmp_path / 'notes.mcap', '', 'is not an MCAP file'),
        (tmp_path / 'empty.mcap', '', 'is empty: record or copy'),
        (bag / 'metadata.yaml', '', "pass the bag's directory"),
        (bag, '/states', r'no topic /states: choose one of /arm_mode \(std_msgs/msg/String'),
        (bag, '/motor_states', 'contains no messages of topic /motor_states'),
        (bag, '/arm_mode', 'has the type std_msgs/msg/String'),
        (broken, '', 'cannot be decoded'),
        (write_bag(joint_states(repeated), 'repeated'), '', 'names joint a more than once: check'),
    ):
        with pytest.raises(BagError, match=said):
            read_joint_states(path, topic or '/joint_states')
