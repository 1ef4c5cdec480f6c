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

STRING = RecordedTopic('/text', 'std_msgs/msg/String')


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_rosbags_reads_the_written_bag(write_bag, recording, compression: str) -> None:
    directory = write_bag(compression=compression)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(directory) as reader:
        assert reader.message_count == 200
        by_topic = {connection.topic: connection for connection in reader.connections}
        assert set(by_topic) == {topic.name for topic in recording.topics}
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


def test_the_mcap_package_reads_an_indexed_file_with_schemas(write_bag) -> None:
    directory = write_bag()
    with (directory / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 200
        assert summary.chunk_indexes
        schema = next(x for x in summary.schemas.values() if x.name.endswith('JointState'))
        assert 'MSG: std_msgs/Header' in schema.data.decode()
        found = list(reader.iter_messages(['/motor_states']))
        assert [message.sequence for _, _, message in found] == list(range(1, 101))
        assert [record.name for record in reader.iter_metadata()] == ['rosbag2']


def test_metadata_has_the_format_of_ros2_bag_info(write_bag) -> None:
    content = yaml.safe_load((write_bag() / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert (information['version'], information['storage_identifier']) == (9, 'mcap')
    assert information['message_count'] == 200
    assert information['duration']['nanoseconds'] == 99_000_000
    assert information['relative_file_paths'] == ['bag_0.mcap']
    counts = {
        topic['topic_metadata']['name']: topic['message_count']
        for topic in information['topics_with_message_count']
    }
    assert counts == {'/joint_states': 100, '/motor_states': 100, '/arm_mode': 0}


def test_messages_are_put_in_order_of_reception(tmp_path: Path) -> None:
    log_times = [5, 3, 4, 1, 2]
    with BagWriter(tmp_path / 'bag', [STRING]) as writer:
        for log_time in log_times:
            writer.write(RecordedMessage(0, b'', log_time, 0, 0))
    writer.close()  # again, which does nothing
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        assert [message.log_time for _, _, message in found] == sorted(log_times)


def test_an_unknown_type_is_recorded_without_a_definition(tmp_path: Path) -> None:
    topics = [RecordedTopic('/own', 'own_msgs/msg/Own')]
    with BagWriter(tmp_path / 'bag', topics) as writer:
        writer.write(RecordedMessage(0, b'abc', 1, 1, 1))
    with Reader(tmp_path / 'bag') as reader:
        assert [bytes(payload) for _, _, payload in reader.messages()] == [b'abc']


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


def test_never_overwrites(write_bag, recording) -> None:
    directory = write_bag()
    with pytest.raises(BagError, match='exists'):
        BagWriter(directory, recording.topics)
    assert (directory / 'bag_0.mcap').stat().st_size > 1000


def test_an_impossible_directory_raises_an_error_with_the_reason(tmp_path: Path, recording) -> None:
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match='cannot be created'):
        BagWriter(tmp_path / 'file' / 'bag', recording.topics)
    with pytest.raises(BagError, match='choose one of none, lz4, zstd'):
        BagWriter(tmp_path / 'bag', recording.topics, compression='zip')
    assert not (tmp_path / 'bag').exists()


@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='no /dev/full')
def test_a_full_disk_is_reported(tmp_path: Path, recording) -> None:
    writer = BagWriter(tmp_path / 'bag', recording.topics)
    full = os.open('/dev/full', os.O_WRONLY)
    os.dup2(full, writer.fileno())
    os.close(full)
    for message in recording.messages(10):
        writer.write(message)
    with pytest.raises(BagError, match='No space left'):
        writer.close()


def test_a_failed_write_raises_an_error(tmp_path: Path, recording) -> None:
    writer = BagWriter(tmp_path / 'bag', recording.topics)
    writer.write(RecordedMessage(len(recording.topics), b'', 1, 1, 1))  # of no topic of the bag
    with pytest.raises(BagError, match='cannot be written'):
        writer.close()
