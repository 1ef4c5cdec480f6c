"""Incomplete bags are distinguished from bags whose recorder was killed."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import JointMapping
from aerarm_ros.identification.recording.table_file import TableOptions
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags

JOINTS = ('a', 'b')
KIND = 'sensor_msgs/msg/JointState'
COUNT = 400


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / 'bag'
    codec = JointStateCdr(JOINTS)
    topics = [RecordedTopic('/arm/joint_states', KIND), RecordedTopic('/arm/joint_command', KIND)]
    with BagWriter(path, topics, compression='none') as writer:
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
    read = reader.read(bag, 'name')
    recording, desired = read.recording, read.desired
    assert recording.name == 'name'
    assert len(recording.time) == COUNT
    assert desired is not None
    assert len(desired.time) == COUNT // 2
    wanted = np.interp(desired.time, recording.time, recording.dq[:, 0])
    assert np.allclose(desired.dq[:, 0], 2.0 * wanted, atol=1e-3)
    assert not reader.messages


def test_a_table_is_a_bag_without_commands(tmp_path: Path) -> None:
    angle = 0.05 * np.arange(COUNT)
    values = np.column_stack([np.degrees(np.sin(angle)), np.degrees(np.cos(angle)), angle, -angle])
    path = tmp_path / 'motion.CSV'
    np.savetxt(path, values, header='q_a,q_b,tau_a,tau_b', comments='', delimiter=',')
    table = TableOptions(rate=100.0, degrees=True)
    reader = IdentifierBags('/joint_states', JOINTS, JointMapping({}), table=table)
    read = reader.read(path, 'motion')
    assert read.desired is None
    assert read.recording.dq is None
    assert np.allclose(np.diff(read.recording.time), 0.01)
    assert np.ptp(read.recording.q, axis=0) == pytest.approx([2.0, 2.0], abs=0.01)
    assert read.facts.lost is None


@pytest.mark.parametrize(('missed', 'said'), [(20, ['4.8 %']), (4, [])])
def test_many_missed_cycles_are_warned_of(tmp_path: Path, missed: int, said: list) -> None:
    codec = JointStateCdr(JOINTS)
    topics = [
        RecordedTopic('/arm/joint_states', KIND),
        RecordedTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'),
    ]
    with BagWriter(tmp_path / 'bag', topics) as writer:
        for k in range(COUNT):
            stamp = 10**18 + k * 10**7
            angle = np.array([np.sin(0.05 * k), np.cos(0.05 * k)])
            state = codec.pack(stamp, angle, angle, 3.0 * angle)
            writer.write(RecordedMessage(0, state, stamp, stamp, k + 1))
            if k in (0, COUNT - 1):
                value = KeyValue(key='missed cycles', value=str(7 + missed * bool(k)))
                timing = DiagnosticStatus(name='bridge: timing', values=[value])
                payload = serialize_message(DiagnosticArray(status=[timing]))
                writer.write(RecordedMessage(1, payload, stamp, stamp, k + 1))
    reader = bags()
    assert reader.read(tmp_path / 'bag', 'name').facts.missed_cycles == missed
    words = 'of the cycles were missed'
    assert [text.split(f' {words}')[0] for text in reader.messages] == [
        f'name: {share}' for share in said
    ]


def test_fewer_messages_than_in_the_metadata_are_reported_as_truncated(bag: Path) -> None:
    set_count(bag, COUNT + 1)
    reader = bags()
    assert len(reader.read(bag, 'bag').recording.time) == COUNT
    assert f'truncated: it contains {COUNT} of the {COUNT + 1} messages' in reader.messages[-1]


@pytest.mark.parametrize('count', [0, COUNT - 50])
def test_a_killed_recorder_leaves_less_in_the_metadata(bag: Path, count: int) -> None:
    set_count(bag, count)
    reader = bags()
    assert len(reader.read(bag, 'bag').recording.time) == COUNT
    assert f'but metadata.yaml lists {count}, because the recorder was killed' in reader.messages[0]


def test_without_metadata_a_finished_file_speaks_for_itself(bag: Path) -> None:
    for spoil in (lambda file: file.write_text('{'), Path.unlink):
        spoil(bag / 'metadata.yaml')
        reader = bags()
        assert len(reader.read(bag, 'bag').recording.time) == COUNT
        assert not reader.messages


def cut(bag: Path) -> Path:
    """Cut a bag in the middle of its messages."""
    (file,) = bag.glob('*.mcap')
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    return file


def test_a_cut_bag_without_metadata_is_used_with_a_warning(bag: Path) -> None:
    cut(bag)
    (bag / 'metadata.yaml').unlink()
    reader = bags()
    assert 0 < len(reader.read(bag, 'bag').recording.time) < COUNT
    assert 'is cut off' in reader.messages[0]
    assert 'the recording may be incomplete' in reader.messages[1]


def test_a_single_file_is_checked_as_its_directory_is(bag: Path) -> None:
    file = next(bag.glob('*.mcap'))
    reader = bags()
    assert len(reader.read(file, 'bag').recording.time) == COUNT
    assert not reader.messages
    assert 0 < len(reader.read(cut(bag), 'bag').recording.time) < COUNT
    assert 'is truncated' in reader.messages[-1]


def test_without_commands_nothing_is_desired(tmp_path: Path, bag: Path) -> None:
    assert bags().read(bag, 'bag').desired is not None
    codec = JointStateCdr(JOINTS)
    with BagWriter(tmp_path / 'states', [RecordedTopic('/arm/joint_states', KIND)]) as writer:
        for k in range(COUNT):
            angle = np.array([np.sin(0.05 * k), np.cos(0.05 * k)])
            state = codec.pack(10**18 + k * 10**7, angle, angle, 3.0 * angle)
            writer.write(RecordedMessage(0, state, k, k, k + 1))
    assert bags().read(tmp_path / 'states', 'bag').desired is None


def test_a_gain_of_an_unknown_joint_is_refused() -> None:
    mapping = JointMapping({}, effort_gain={'c': 2.0})
    with pytest.raises(IdentificationError, match='unknown joint c: the URDF has a, b'):
        IdentifierBags('/arm/joint_states', JOINTS, mapping)


MODES = ((0, 'ready'), (100, 'running'), (150, 'damping'), (200, 'running'), (350, 'damping'))


@pytest.mark.parametrize(
    ('modes', 'rows', 'reason'),
    [
        (MODES, (200, 350), 'arm_mode running, the longest of 2 motions'),
        (MODES[1:3], (0, 150), 'arm_mode running'),
        (MODES[:1], (0, 400), 'joint_command'),
    ],
)
def test_only_the_running_arm_is_used(
    tmp_path: Path, modes: tuple[tuple[int, str], ...], rows: tuple[int, int], reason: str
) -> None:
    """Messages in other modes contain invalid data, which must have no effect."""
    codec = JointStateCdr(JOINTS)
    topics = [
        *(RecordedTopic(f'/arm/{name}', KIND) for name in ('joint_states', 'joint_command')),
        RecordedTopic('/arm/arm_mode', 'std_msgs/msg/String'),
    ]
    with BagWriter(tmp_path / 'bag', topics) as writer:
        for k in range(COUNT):
            stamp = 10**18 + k * 10**7
            for begin, mode in modes:
                if begin == k:
                    text = mode.encode() + b'\0'
                    payload = b'\0\1\0\0' + len(text).to_bytes(4, 'little') + text
                    writer.write(RecordedMessage(2, payload, stamp, stamp, 0))
            angle = np.array([np.sin(0.05 * k), np.cos(0.05 * k)])
            effort = 3.0 * angle if rows[0] <= k < rows[1] else np.full(2, np.nan)
            state = codec.pack(stamp, angle, angle, effort)
            writer.write(RecordedMessage(0, state, stamp + 1, stamp, k + 1))
            writer.write(RecordedMessage(1, codec.pack(stamp, None, angle), stamp + 2, stamp, 0))
    read = bags().read(tmp_path / 'bag', 'bag')
    time = read.recording.time
    assert (time[0], time[-1]) == pytest.approx((0.01 * rows[0], 0.01 * (rows[1] - 1)))
    assert read.facts.used == f'{time[0]:.1f} .. {time[-1]:.1f} s of 4.0 s ({reason})'
    assert read.facts.lost == 0
