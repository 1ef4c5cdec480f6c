"""Decompression of one MCAP chunk, whole or cut off."""

import zlib

import lz4.frame
import zstandard
from mcap.records import Chunk

_LARGEST = 2**30


class ChunkError(Exception):
    """A chunk that is damaged."""


def chunk_records(chunk: Chunk) -> bytes:
    """Return the records inside a complete chunk.

    Raises
    ------
    ChunkError
        If the compression is unknown, the data is damaged or its checksum wrong.
    """
    if chunk.uncompressed_size > _LARGEST:
        raise ChunkError(f'it claims to hold {chunk.uncompressed_size} bytes')
    try:
        if chunk.compression == 'zstd':
            records = zstandard.decompress(chunk.data, chunk.uncompressed_size)
        elif chunk.compression == 'lz4':
            records = lz4.frame.decompress(chunk.data)
        elif not chunk.compression:
            records = chunk.data
        else:
            raise ChunkError(f'its compression {chunk.compression!r} is not known')
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ChunkError(str(error)) from error
    if chunk.uncompressed_crc and zlib.crc32(records) != chunk.uncompressed_crc:
        raise ChunkError('its checksum is wrong')
    return bytes(records)


def beginning_of_records(chunk: Chunk) -> bytes:
    """Return what can be had of a chunk whose end is missing, possibly nothing."""
    try:
        if chunk.compression == 'zstd':
            return bytes(zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data))
        if chunk.compression == 'lz4':
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data))
    except (zstandard.ZstdError, RuntimeError):
        return b''
    return b'' if chunk.compression else chunk.data
