"""CDR: constant prefixes, fields in order, messages in a buffer, arrays of numbers."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from aerarm_msgs_py.codecs.cdr import CdrPrefix, CdrReader, Float64ArrayCdr, elements_at


def test_padding_is_open_and_everything_else_is_not() -> None:
    prefix = CdrPrefix(4, '', ('a', 'b'))
    payload = bytearray(b'\0\1\0\0' + prefix.content)
    padding = {9, 10, 11, 22, 23, 30, 31}  # behind '\0', 'a\0' and 'b\0'
    for k in range(4, len(payload)):
        changed = payload.copy()
        changed[k] ^= 0x55
        assert prefix.matches(bytes(changed)) == (k in padding)
    assert not prefix.matches(bytes(payload[:-1]))


def test_refuses_short_and_foreign_payloads() -> None:
    for foreign in (b'\0\7\0\0abcd', b''):
        with pytest.raises(ValueError, match='plain CDR'):
            CdrReader(foreign)
    endless = b'\0\1\0\0' + struct.pack('<I', 10**9)
    for read in (CdrReader.strings, CdrReader.doubles, CdrReader.string):
        with pytest.raises(ValueError, match='too early'):
            read(CdrReader(endless))


@given(st.lists(st.floats(), min_size=1, max_size=9))
def test_arrays_agree_with_the_ordinary_codec(data: list[float]) -> None:
    cdr = Float64ArrayCdr(len(data))
    message = deserialize_message(cdr.pack(data), Float64MultiArray)
    np.testing.assert_array_equal(message.data, data)
    assert (message.layout.dim, message.layout.data_offset) == ([], 0)
    payload = serialize_message(Float64MultiArray(data=data))
    np.testing.assert_array_equal(cdr.unpack(payload), data)


def test_arrays_of_another_layout_are_not_decoded() -> None:
    cdr = Float64ArrayCdr(3)
    labelled = Float64MultiArray(data=[1.0, 2.0, 3.0])
    labelled.layout.dim = [MultiArrayDimension(label='motor', size=3, stride=3)]
    assert cdr.unpack(serialize_message(labelled)) is None
    assert cdr.unpack(serialize_message(Float64MultiArray(data=[1.0, 2.0]))) is None
    assert cdr.unpack(cdr.pack([1, 2, 3])[:-1]) is None
    assert cdr.unpack(b'\0\0' + cdr.pack([1, 2, 3])[2:]) is None
    with pytest.raises(ValueError, match='3 numbers'):
        cdr.pack([1.0])
    with pytest.raises(ValueError, match='at least one'):
        Float64ArrayCdr(0)


def test_elements_may_begin_at_any_byte_but_not_beyond_the_end() -> None:
    kind = np.dtype('<u2')
    assert elements_at(b'\1\0\2', kind, np.array([0, 1])).tolist() == [1, 512]
    assert len(elements_at(b'', kind, np.array([], np.int64))) == 0
    for buffer, place in ((b'\1\0\2', 2), (b'\1', 0)):
        with pytest.raises(IndexError):
            elements_at(buffer, kind, np.array([place]))
