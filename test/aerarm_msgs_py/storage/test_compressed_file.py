"""Limits, decompression, and bags compressed as a whole or message by message."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from bag_originals import originals

from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.storage.compressed_file import decompress
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning, ReadBudget, ReadLimits

COUNT = 200
DATA = np.random.default_rng(3).integers(0, 50, 400_000, np.uint8).tobytes()
COMPRESS = {
    '': bytes,
    'lz4': lz4.frame.compress,
    'zstd': zstandard.ZstdCompressor(write_content_size=False).compress,
}
BY_MESSAGE = 'SQLite, compressed messages'


def test_the_memory_of_a_bag_is_limited_to_a_multiple_of_its_size() -> None:
    for wrong in ({'ratio': 0.0}, {'ratio': float('nan')}, {'part_bytes': 0}):
        with pytest.raises(BagError, match='set it to 1 or more'):
            ReadLimits(**wrong)
    budget = ReadBudget(Path('bag'), 10_000_000, ReadLimits(ratio=3.0))
    budget.spend(20_000_000)
    budget.spend(10_000_000)
    with pytest.raises(BagError, match='10000000 bytes needs more than 3 times this size'):
        budget.spend(1)
    ReadBudget(Path('bag'), 1, ReadLimits(ratio=1.0)).spend(4_000_000)


@pytest.mark.parametrize('compression', COMPRESS)
def test_data_are_decompressed_up_to_their_end_their_damage_or_a_limit(compression: str) -> None:
    compressed = COMPRESS[compression](DATA)
    assert decompress(compressed, compression, len(DATA) + 1) == DATA
    assert decompress(compressed, compression, 1000) == DATA[:1000]
    assert decompress(compressed, compression, 0) == b''
    half = decompress(compressed[: len(compressed) // 2], compression, len(DATA))
    assert len(half) > len(DATA) // 4
    assert DATA.startswith(half)
    if compression:
        assert decompress(b'no frame at all', compression, 1000) == b''
        bomb = COMPRESS[compression](bytes(200_000_000))
        tracemalloc.start()
        assert decompress(bomb, compression, 1000) == bytes(1000)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
        tracemalloc.stop()


def test_an_unknown_compression_is_named() -> None:
    with pytest.raises(ValueError, match="unknown compression 'brotli'"):
        decompress(b'', 'brotli', 0)


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    """Return a function that writes a bag of bag_originals.py."""

    def write(name: str) -> Path:
        (bag,) = originals(tmp_path / 'made', name)
        folder = tmp_path / 'bag'
        folder.mkdir()
        for file, content in bag.files.items():
            (folder / file).write_bytes(content)
        return folder

    (tmp_path / 'made').mkdir()
    return write


def test_a_file_that_is_no_frame_or_becomes_too_large_is_refused(write) -> None:
    bag = write('compressed file')
    assert len(read_joint_states(bag)) == COUNT
    file = next(bag.glob('*.zstd'))
    file.write_bytes(zstandard.compress(b'\x89MCAP0\r\n' + bytes(500_000_000)))
    with pytest.raises(BagError, match='more than 100 times this size'):
        read_joint_states(bag)
    file.write_bytes(b'nothing of the kind')
    with pytest.raises(BagError, match='cannot be decompressed'):
        read_joint_states(bag)


def test_messages_that_cannot_be_decompressed_are_counted(write) -> None:
    bag = write(BY_MESSAGE)
    file = next(bag.glob('*.db3'))
    content = file.read_bytes()
    place = content.index(b'\x28\xb5\x2f\xfd', len(content) // 2)
    file.write_bytes(content[:place] + b'\0' + content[place + 1 :])
    with pytest.warns(BagWarning) as caught:
        states, motors = (
            read_joint_states(bag, topic) for topic in ('joint_states', 'motor_states')
        )
    assert sorted((len(states), len(motors))) == [COUNT - 1, COUNT]
    texts = [str(warning.message) for warning in caught]
    assert any('ignores 1 messages of' in t and 'compressed data are damaged' in t for t in texts)
    assert any(f'1 of the {COUNT} messages of' in t and 'are missing' in t for t in texts)
