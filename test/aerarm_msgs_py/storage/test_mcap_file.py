"""Files from other writers."""

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.storage.mcap_file import McapFile
from aerarm_msgs_py.storage.read_limits import BagWarning, ReadBudget


def opened(path: Path) -> McapFile:
    return McapFile(path, ReadBudget(path, path.stat().st_size))


def write(path: Path, messages, **options) -> Path:
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema('sensor_msgs/msg/JointState', 'ros2msg', b'')
        channels = [
            writer.register_channel(name, 'cdr', schema) for name in ('/joint_states', '/other')
        ]
        for m in messages:
            channel = channels[m.topic]
            writer.add_message(channel, m.log_time, m.payload, m.publish_time, m.sequence)
        writer.finish()
    return path


@pytest.mark.parametrize(
    'options',
    [
        {'compression': CompressionType.ZSTD, 'chunk_size': 20_000},
        {'compression': CompressionType.LZ4, 'chunk_size': 20_000},
        {'compression': CompressionType.NONE},
        {'use_chunking': False},
        {'use_summary_offsets': False, 'repeat_channels': False, 'use_statistics': False},
    ],
    ids=['zstd', 'lz4', 'none', 'without chunks', 'without summary'],
)
def test_reads_files_of_the_mcap_package(tmp_path: Path, recording, options) -> None:
    series = read_joint_states(write(tmp_path / 'a.mcap', recording.messages(400), **options))
    np.testing.assert_array_equal(series.velocity, recording.numbers(400)[:, 1])


def test_blocks_hold_a_bounded_part_of_a_file_without_chunks(tmp_path: Path, recording) -> None:
    path = write(tmp_path / 'a.mcap', recording.messages(4000), use_chunking=False)
    blocks = list(opened(path).blocks(['/joint_states']))
    assert sum(len(block.payloads) for block in blocks) == 4000
    assert max(len(block.payloads) for block in blocks) < 3000


def test_a_finished_file_contains_message_counts(tmp_path: Path, recording) -> None:
    path = write(tmp_path / 'a.mcap', recording.messages(40))
    file = opened(path)
    list(file.blocks(['/other']))
    assert file.counts == {'/joint_states': 40, '/other': 40}
    path.write_bytes(path.read_bytes()[:-3000])
    file = opened(path)
    with pytest.warns(BagWarning, match='is cut off'):
        list(file.blocks())
    assert file.counts is None
    assert file.damaged


def test_a_missing_end_is_warned_about(tmp_path: Path, recording) -> None:
    path = write(tmp_path / 'a.mcap', recording.messages(400), use_chunking=False)
    content = path.read_bytes()
    end = content.index(b'\x0f\x04\0\0\0\0\0\0\0')  # the record that ends the messages
    for changed, count in (
        *((content[: end - cut], 399) for cut in (1, 5, 9, 30, 100)),
        (content[:end] + bytes(500), 400),
    ):
        path.write_bytes(changed)
        with pytest.warns(BagWarning, match='is cut off'):
            blocks = list(opened(path).blocks(['/other']))
        assert sum(len(block.payloads) for block in blocks) == count
