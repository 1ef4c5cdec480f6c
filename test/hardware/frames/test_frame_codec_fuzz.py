"""A million frames that no board sent: none may raise, none may be accepted."""

import numpy as np
import pytest
from crc_table import crc32_mpeg2_rows

from aerarm_ros.hardware.frames.board_messages import BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile

CODEC = FrameCodec(load_profile())
CHUNK = 50_000


def accepted(frames):
    """Return the number of frames (M, 34) that the decoder accepts."""
    rows = frames.tobytes()
    decode = CODEC.decode
    return sum(decode(rows[i : i + 34]) is not None for i in range(0, len(rows), 34))


def valid_frames(rng, count):
    """Return frames (count, 34) with random payloads and correct checks."""
    payload = rng.integers(0, 256, (count, 30), dtype=np.uint8)
    crc = crc32_mpeg2_rows(payload)
    swapped = (crc << np.uint32(16)) | (crc >> np.uint32(16))
    check = swapped.astype('>u4').view(np.uint8).reshape(count, 4)
    return np.hstack([payload, check])


def with_flipped_bits(rng, frames, flips):
    damaged = np.unpackbits(frames, axis=1)
    rows = np.arange(len(frames))[:, None]
    # Distinct bits: the smallest of random keys.
    bits = np.argpartition(rng.random(damaged.shape, dtype=np.float32), flips, axis=1)[:, :flips]
    damaged[rows, bits] ^= 1
    return np.packbits(damaged, axis=1)


def with_burst(rng, frames):
    """Return frames in which up to 32 bits in a row were replaced, at least the first flipped."""
    damaged = np.unpackbits(frames, axis=1)
    for row in damaged:
        start = rng.integers(0, row.size - 32)
        row[start + 1 : start + 32] = rng.integers(0, 2, 31, dtype=np.uint8)
        row[start] ^= 1
    return np.packbits(damaged, axis=1)


def test_frames_with_correct_checks_are_accepted_whatever_they_hold():
    frames = valid_frames(np.random.default_rng(1), 10_000)
    assert accepted(frames) == len(frames)


def with_shift(rng, frames, shift):
    """Return frames shifted by bytes, of which one was lost or doubled on the wire."""
    return np.roll(frames, shift, axis=1)


@pytest.mark.parametrize(
    ('damage', 'arguments'),
    [
        (with_burst, ()),
        *((with_flipped_bits, (flips,)) for flips in (1, 2, 3, 5)),
        *((with_shift, (shift,)) for shift in (1, 2)),
    ],
)
def test_damaged_frames_are_refused(damage, arguments):
    rng = np.random.default_rng(3)
    for _ in range(2):
        assert accepted(damage(rng, valid_frames(rng, CHUNK), *arguments)) == 0


def test_random_frames_are_refused():
    rng = np.random.default_rng(2)
    for _ in range(10):
        assert accepted(rng.integers(0, 256, (CHUNK, 34), dtype=np.uint8)) == 0


def test_frames_of_any_length_are_refused_without_an_exception():
    rng = np.random.default_rng(5)
    state = BoardState()
    for length in range(80):
        if length != 34:
            assert CODEC.decode(rng.bytes(length), state) is None
