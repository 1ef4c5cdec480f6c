"""Decompression that stops at a bound."""

from collections.abc import Iterator

import lz4.frame
import zstandard

_PIECE = 2**17  # bytes
_LARGEST_WINDOW = 2**27  # bytes that a zstd frame may ask for beside its content
_LZ4_RATIO = 255  # the format's own bound
_UNKNOWN_SIZES = (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR)
_FAILURES = (zstandard.ZstdError, RuntimeError, MemoryError)

COMPRESSIONS = ('', 'lz4', 'zstd')
"""What chunks may be compressed with; '' is none."""


class DecompressionError(ValueError):
    """Data that is damaged, or is not as large as it claims."""


def check_claim(data: bytes, compression: str, size: int) -> None:
    """Require that data can become as large as it claims to, before anything is decompressed.

    Raises
    ------
    DecompressionError
        If the compression isn't known or the data can't be that large.
    """
    if compression not in COMPRESSIONS:
        raise DecompressionError(f'its compression {compression[:20]!r} is not known')
    possible = True
    if not compression:
        possible = len(data) == size
    elif compression == 'lz4':
        possible = size <= _LZ4_RATIO * len(data)
    else:
        content = content_size(data)
        possible = content is None or content == size
    if not possible:
        raise DecompressionError(f'it claims to hold {size} bytes, which it cannot')


def content_size(data: bytes) -> int | None:
    """Return how large a zstd frame says its content is, None if it doesn't say.

    Raises
    ------
    DecompressionError
        If it isn't a zstd frame.
    """
    try:
        size = int(zstandard.get_frame_parameters(data).content_size)
    except _FAILURES as error:
        raise DecompressionError(str(error)) from None
    return None if size in _UNKNOWN_SIZES else size


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Return data that claims to hold `size` bytes, and stop there.

    Raises
    ------
    DecompressionError
        If it is damaged or holds more or less.
    """
    check_claim(data, compression, size)
    if not compression or not size:
        records = b'' if not size else data
    else:
        try:
            if compression == 'zstd':
                decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
                records = decompressor.decompress(data, max_output_size=size)
            else:
                records = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        except _FAILURES as error:
            raise DecompressionError(str(error)) from None
    if len(records) != size:
        raise DecompressionError(f'it holds {len(records)} bytes instead of {size}')
    return bytes(records)


def beginning(data: bytes, compression: str, most: int) -> bytes:
    """Return what can be had of data whose end is missing or damaged, at most some bytes."""
    if not compression:
        return data[:most]
    parts: list[bytes] = []
    pieces = _zstd_pieces(data) if compression == 'zstd' else _lz4_pieces(data)
    try:
        for piece in pieces if compression in COMPRESSIONS else ():
            parts.append(piece[:most])
            most -= len(parts[-1])
            if not most:
                break
    except _FAILURES:
        pass  # what came before is sound
    return b''.join(parts)


def _zstd_pieces(data: bytes) -> Iterator[bytes]:
    decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    with decompressor.stream_reader(data) as reader:
        while piece := reader.read(_PIECE):
            yield piece


def _lz4_pieces(data: bytes) -> Iterator[bytes]:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    given = 0
    while not decompressor.eof and (given < len(data) or not decompressor.needs_input):
        more = b''
        if decompressor.needs_input:
            more = data[given : given + _PIECE]
            given += len(more)
        if piece := decompressor.decompress(more, max_length=_PIECE):
            yield piece
