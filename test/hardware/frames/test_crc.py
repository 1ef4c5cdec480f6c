import numpy as np
import pytest
from crc_table import crc32_mpeg2_rows
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.hardware.frames.board_messages import crc32_mpeg2


def crc(data):
    return int.from_bytes(crc32_mpeg2(data), 'big')


@pytest.mark.parametrize(
    ('data', 'value'),
    [
        (b'123456789', 0x0376E6E7),  # published check value
        (bytes(30), 0x5283DFFF),  # start-up constant of the firmware
        (bytes.fromhex('f014') + bytes(24) + bytes.fromhex('28280000'), 0x7F26E373),  # enable
        (b'', 0xFFFFFFFF),
    ],
)
def test_known_check_values(data, value):
    assert crc(data) == value


@given(st.binary(min_size=30, max_size=30), st.integers(0, 239))
def test_any_single_bit_changes_it(payload, bit):
    damaged = bytearray(payload)
    damaged[bit // 8] ^= 1 << bit % 8
    assert crc(bytes(damaged)) != crc(payload)


@given(st.lists(st.binary(min_size=30, max_size=30), min_size=1, max_size=20))
def test_table_of_many_agrees(rows):
    table = np.frombuffer(b''.join(rows), dtype=np.uint8).reshape(len(rows), 30)
    assert crc32_mpeg2_rows(table).tolist() == [crc(row) for row in rows]
