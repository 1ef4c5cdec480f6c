import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.storage.read_limits import BagError


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_other_libraries_read_the_written_bag(write_bag, recording, compression: str) -> None:
    directory = write_bag(compression=compression)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(directory) as reader:
        by_topic = {connection.topic: connection for connection in reader.connections}
        counts = {topic: connection.msgcount for topic, connection in by_topic.items()}
        assert counts == {'/joint_states': 100, '/motor_states': 100, '/arm_mode': 0}
        mode = by_topic['/arm_mode'].ext.offered_qos_profiles[0]
        assert mode.durability == QosDurability.TRANSIENT_LOCAL
        states = by_topic['/joint_states']
        assert states.ext.offered_qos_profiles[0].reliability == QosReliability.BEST_EFFORT
        assert states.digest == store.hash_rihs01('sensor_msgs/msg/JointState')
        found = [
            store.deserialize_cdr(payload, connection.msgtype)
            for connection, _, payload in reader.messages([states])
        ]
    assert found[0].name == list(recording.names)
    np.testing.assert_array_equal([x.position for x in found], recording.numbers(100)[:, 0])
    with (directory / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 200
        assert summary.chunk_indexes
        schema = next(x for x in summary.schemas.values() if x.name.endswith('JointState'))
        assert 'MSG: std_msgs/Header' in schema.data.decode()
        messages = list(reader.iter_messages(['/motor_states']))
        assert [message.sequence for _, _, message in messages] == list(range(1, 101))
        assert [record.name for record in reader.iter_metadata()] == ['rosbag2']


def test_metadata_has_the_format_of_ros2_bag_info(write_bag) -> None:
    content = yaml.safe_load((write_bag() / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert (information['version'], information['storage_identifier']) == (9, 'mcap')
    assert information['message_count'] == 200
    assert information['duration']['nanoseconds'] == 99_000_000
    assert information['relative_file_paths'] == ['bag_0.mcap']


def test_messages_of_any_type_are_put_in_order_of_reception(tmp_path: Path) -> None:
    log_times = [5, 3, 4, 1, 2]
    unknown = RecordedTopic('/own', 'own_msgs/msg/Own')  # recorded without a definition
    with BagWriter(tmp_path / 'bag', [unknown]) as writer:
        for log_time in log_times:
            writer.write(RecordedMessage(0, b'abc', log_time, 0, 0))
    writer.close()  # again, which does nothing
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        assert [message.log_time for _, _, message in found] == sorted(log_times)
    with Reader(tmp_path / 'bag') as reader:
        assert [bytes(payload) for _, _, payload in reader.messages()] == [b'abc'] * 5


def test_a_killed_writer_leaves_a_bag_that_opens(tmp_path: Path) -> None:
    directory = tmp_path / 'bag'
    script = Path(__file__).with_name('endless_writer.py')
    with subprocess.Popen([sys.executable, str(script), str(directory)]) as process:
        try:
            _wait_until_stored(directory, 300)
        finally:
            process.kill()
    killed = time.time_ns()
    with Reader(directory) as reader:
        log_times = [log_time for _, log_time, _ in reader.messages()]
    assert len(log_times) >= 300
    # The last chunk's period, the disorder allowed for, and generously for a busy machine.
    assert killed - log_times[-1] < 5e9
    with (directory / 'bag_0.mcap').open('rb') as stream:
        found = [message.sequence for _, _, message in make_reader(stream).iter_messages()]
    assert found == list(range(1, len(log_times) + 1))


def _wait_until_stored(directory: Path, count: int) -> None:
    """Wait for the writer's thread, whose metadata lists the stored messages."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        metadata = directory / 'metadata.yaml'
        content = yaml.safe_load(metadata.read_text()) if metadata.exists() else None
        if content and content['rosbag2_bagfile_information']['message_count'] >= count:
            return
        time.sleep(0.1)
    raise TimeoutError(f'{count} messages were not stored')


def test_an_impossible_bag_raises_an_error_with_the_reason(tmp_path, write_bag, recording) -> None:
    bag = write_bag()
    (tmp_path / 'file').touch()
    for directory, said in ((bag, 'exists'), (tmp_path / 'file' / 'bag', 'cannot be written')):
        with pytest.raises(BagError, match=said):
            BagWriter(directory, recording.topics)
    assert (bag / 'bag_0.mcap').stat().st_size > 1000


@pytest.mark.parametrize('is_full', [True, False])
def test_a_failed_write_raises_an_error(tmp_path: Path, recording, is_full: bool) -> None:
    writer = BagWriter(tmp_path / 'bag', recording.topics)
    if is_full:
        full = os.open('/dev/full', os.O_WRONLY)
        os.dup2(full, writer.fileno())
        os.close(full)
        for message in recording.messages(10):
            writer.write(message)
    else:
        writer.write(RecordedMessage(len(recording.topics), b'', 1, 1, 1))  # of no topic
    with pytest.raises(BagError, match='No space left' if is_full else 'cannot be written'):
        writer.close()
