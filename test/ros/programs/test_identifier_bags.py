"""Incomplete bags are distinguished from bags whose recorder was killed."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.identification.recording.recording import JointMapping
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags

JOINTS = ('a', 'b')
KIND = 'sensor_msgs/msg/JointState'
COMMANDS = RecordedTopic('/arm/joint_command', KIND)
COUNT = 400
CODEC = JointStateCdr(JOINTS)


def written(
    path: Path,
    others: Iterable[RecordedTopic] = (),
    messages: Callable[[int, np.ndarray], Iterable[tuple[int, bytes]]] = lambda *_: (),
    running: tuple[int, int] = (0, COUNT),
) -> Path:
    """Write states whose effort is valid in `running`, and messages of other topics by number."""
    topics = [RecordedTopic('/arm/joint_states', KIND), *others]
    with BagWriter(path, topics, compression='none') as writer:
        for k in range(COUNT):
            stamp = 10**18 + k * 10**7
            angle = np.array([np.sin(0.05 * k), np.cos(0.05 * k)])
            effort = 3.0 * angle if running[0] <= k < running[1] else np.full(2, np.nan)
            state = CODEC.pack(stamp, angle, angle, effort)
            writer.write(RecordedMessage(0, state, stamp, stamp, k + 1))
            for topic, payload in messages(k, angle):
                writer.write(RecordedMessage(topic, payload, stamp, stamp, k + 1))
    return path


def command(k: int, angle: np.ndarray) -> list[tuple[int, bytes]]:
    """Return a command that answers a state."""
    return [(1, CODEC.pack(10**18 + k * 10**7, None, 2.0 * angle, None))]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return written(tmp_path / 'bag', [COMMANDS], command)


def bags() -> IdentifierBags:
    return IdentifierBags('/arm/joint_states', JOINTS, JointMapping({}))


@pytest.mark.parametrize(('missed', 'said'), [(20, ['4.8 %']), (4, [])])
def test_many_missed_cycles_are_warned_of(tmp_path: Path, missed: int, said: list) -> None:
    def diagnostics(k: int, _: np.ndarray) -> list[tuple[int, bytes]]:
        value = KeyValue(key='missed cycles', value=str(7 + missed * bool(k)))
        status = DiagnosticStatus(name='bridge: timing', values=[value])
        message = (1, serialize_message(DiagnosticArray(status=[status])))
        return [message] if k in (0, COUNT - 1) else []

    topic = RecordedTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    path = written(tmp_path / 'bag', [topic], diagnostics)
    reader = bags()
    read = reader.read(path, 'name')
    assert read.facts.missed_cycles == missed
    words = 'of the cycles were missed'
    assert [text.split(f' {words}')[0] for text in reader.messages] == [
        f'name: {share}' for share in said
    ]


@pytest.mark.parametrize(
    ('count', 'words'),
    [
        (COUNT, ''),
        (COUNT + 1, f'truncated: it contains {COUNT} of the {COUNT + 1} messages'),
        (COUNT - 50, f'but metadata.yaml lists {COUNT - 50}, because the recorder was killed'),
    ],
)
def test_all_states_are_read_and_other_numbers_than_in_the_metadata_reported(
    bag: Path, count: int, words: str
) -> None:
    file = bag / 'metadata.yaml'
    document = yaml.safe_load(file.read_text())
    for entry in document['rosbag2_bagfile_information']['topics_with_message_count']:
        entry['message_count'] = count
    file.write_text(yaml.safe_dump(document))
    reader = bags()
    recording = reader.read(bag, 'name').recording
    assert (recording.name, len(recording.time)) == ('name', COUNT)
    assert bool(reader.messages) == bool(words)
    assert words in ''.join(reader.messages)


def test_a_cut_bag_without_metadata_is_used_with_a_warning(bag: Path) -> None:
    (file,) = bag.glob('*.mcap')
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    (bag / 'metadata.yaml').unlink()
    reader = bags()
    assert 0 < len(reader.read(bag, 'bag').recording.time) < COUNT
    assert 'is cut off' in reader.messages[0]
    assert 'the recording may be incomplete' in reader.messages[1]


MODES = {0: 'ready', 100: 'running', 150: 'damping', 200: 'running', 350: 'damping'}


@pytest.mark.parametrize(
    ('modes', 'rows', 'reason'),
    [
        (MODES, (200, 350), 'arm_mode running, the longest of 2 motions'),
        ({0: 'ready'}, (0, 400), 'joint_command'),
    ],
)
def test_only_the_running_arm_is_used(
    tmp_path: Path, modes: dict[int, str], rows: tuple[int, int], reason: str
) -> None:
    """Messages in other modes contain invalid data, which must have no effect."""

    def others(k: int, angle: np.ndarray) -> list[tuple[int, bytes]]:
        text = modes.get(k, '').encode() + b'\0'
        mode = (2, b'\0\1\0\0' + len(text).to_bytes(4, 'little') + text)
        commands = [(1, CODEC.pack(10**18 + k * 10**7, None, angle))]
        return [mode, *commands] if k in modes else commands

    topics = [COMMANDS, RecordedTopic('/arm/arm_mode', 'std_msgs/msg/String')]
    read = bags().read(written(tmp_path / 'bag', topics, others, rows), 'bag')
    time = read.recording.time
    assert (time[0], time[-1]) == pytest.approx((0.01 * rows[0], 0.01 * (rows[1] - 1)))
    assert read.facts.used == f'{time[0]:.1f} .. {time[-1]:.1f} s of 4.0 s ({reason})'
    assert read.facts.lost == 0
