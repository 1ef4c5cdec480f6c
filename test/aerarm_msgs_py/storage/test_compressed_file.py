"""Bags compressed as a whole, or message by message, that are damaged or bombs."""

from pathlib import Path

import pytest
import zstandard
from bag_originals import originals

from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning

COUNT = 200


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bytes]]:
    return {bag.name: bag.files for bag in originals(tmp_path_factory.mktemp('bags'))}


def written(folder: Path, files: dict[str, bytes]) -> Path:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def test_a_file_that_becomes_too_large_is_refused(tmp_path: Path, made) -> None:
    bag = written(tmp_path, made['compressed file'])
    assert len(read_joint_states(bag)) == COUNT
    file = next(bag.glob('*.zstd'))
    file.write_bytes(zstandard.compress(b'\x89MCAP0\r\n' + bytes(500_000_000)))
    with pytest.raises(BagError, match='more than 100 times this size'):
        read_joint_states(bag)


def test_a_file_that_cannot_be_decompressed_is_refused(tmp_path: Path, made) -> None:
    bag = written(tmp_path, made['compressed file'])
    next(bag.glob('*.zstd')).write_bytes(b'nothing of the kind')
    with pytest.raises(BagError, match='cannot be decompressed'):
        read_joint_states(bag)


def test_messages_that_cannot_be_decompressed_are_counted(tmp_path: Path, made) -> None:
    bag = written(tmp_path, made['SQLite, compressed messages'])
    file = next(bag.glob('*.db3'))
    content = file.read_bytes()
    frame = b'\x28\xb5\x2f\xfd'
    place = content.index(frame, len(content) // 2)
    file.write_bytes(content[:place] + b'\0' + content[place + 1 :])
    with pytest.warns(BagWarning) as caught:
        states, motors = (
            read_joint_states(bag, topic) for topic in ('joint_states', 'motor_states')
        )
    assert sorted((len(states), len(motors))) == [COUNT - 1, COUNT]
    texts = [str(warning.message) for warning in caught]
    assert any('ignores 1 messages of' in t and 'compressed data are damaged' in t for t in texts)
    assert any(f'1 of the {COUNT} messages of' in t and 'are missing' in t for t in texts)
