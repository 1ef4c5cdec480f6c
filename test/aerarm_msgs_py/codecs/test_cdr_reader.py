import struct

import numpy as np
import pytest

from aerarm_msgs_py.codecs.cdr import CdrReader


@pytest.mark.parametrize('order', ['<', '>'])
def test_reads_both_byte_orders(order: str) -> None:
    body = struct.pack(f'{order}iI', -7, 9)
    body += struct.pack(f'{order}I3s', 3, b'ab\0') + b'?'  # a string and one byte of padding
    body += struct.pack(f'{order}I', 2) + b'????'  # a count, aligned to 8 for the doubles
    body += struct.pack(f'{order}dd', 1.5, -2.5)
    reader = CdrReader((b'\0\1\0\0' if order == '<' else b'\0\0\0\0') + body)
    assert (reader.int32(), reader.uint32(), reader.string()) == (-7, 9, 'ab')
    np.testing.assert_array_equal(reader.doubles(), [1.5, -2.5])


def test_an_empty_sequence_has_no_padding() -> None:
    reader = CdrReader(b'\0\1\0\0' + struct.pack('<II', 0, 5))
    assert len(reader.doubles()) == 0
    assert reader.uint32() == 5


def test_refuses_short_and_foreign_payloads() -> None:
    with pytest.raises(ValueError, match='plain CDR'):
        CdrReader(b'\0\7\0\0abcd')
    with pytest.raises(ValueError, match='plain CDR'):
        CdrReader(b'')
    with pytest.raises(ValueError, match='too early'):
        CdrReader(b'\0\1\0\0' + struct.pack('<I', 10**9)).strings()
    with pytest.raises(ValueError, match='too early'):
        CdrReader(b'\0\1\0\0' + struct.pack('<I', 10**9)).doubles()
    with pytest.raises(ValueError, match='too early'):
        CdrReader(b'\0\1\0\0\1').uint32()
