"""Decompression that ignores declared sizes and stops at its limit."""

import tracemalloc

import lz4.frame
import numpy as np
import pytest
import zstandard

from aerarm_msgs_py.storage.compressed_file import DecompressionError, beginning, decompress

DATA = np.random.default_rng(3).integers(0, 50, 400_000, np.uint8).tobytes()
COMPRESS = {
    '': bytes,
    'lz4': lz4.frame.compress,
    'zstd': zstandard.ZstdCompressor(write_content_size=False).compress,
}


@pytest.mark.parametrize('compression', COMPRESS)
def test_data_comes_back_if_it_is_as_large_as_it_claims(compression: str) -> None:
    compressed = COMPRESS[compression](DATA)
    assert decompress(compressed, compression, len(DATA)) == DATA
    for size in (0, 1, len(DATA) - 1, len(DATA) + 1, 2**40):
        if size or compression == '':
            with pytest.raises(DecompressionError):
                decompress(compressed, compression, size)
    assert decompress(COMPRESS[compression](b''), compression, 0) == b''


@pytest.mark.parametrize('compression', ['lz4', 'zstd'])
def test_a_bomb_takes_no_more_memory_than_it_claims(compression: str) -> None:
    bomb = COMPRESS[compression](bytes(200_000_000))
    tracemalloc.start()
    with pytest.raises(DecompressionError):
        decompress(bomb, compression, 1000)
    assert len(beginning(bomb, compression, 1000)) == 1000
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


@pytest.mark.parametrize('compression', COMPRESS)
def test_the_beginning_of_cut_or_damaged_data_is_had(compression: str) -> None:
    compressed = COMPRESS[compression](DATA)
    found = beginning(compressed[: len(compressed) // 2], compression, len(DATA))
    assert len(found) > len(DATA) // 4
    assert DATA.startswith(found)
    assert beginning(compressed, compression, len(DATA)) == DATA
    assert DATA.startswith(beginning(compressed, compression, 1000))
    if compression:
        assert beginning(b'no frame at all', compression, 1000) == b''


def test_an_unknown_compression_is_named() -> None:
    with pytest.raises(DecompressionError, match="unknown compression 'brotli'"):
        decompress(b'', 'brotli', 0)
    assert beginning(b'abc', 'brotli', 10) == b''
