import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr

data_lists = st.lists(st.floats(), min_size=1, max_size=9)


@given(data_lists)
def test_agrees_with_the_ordinary_codec(data: list[float]) -> None:
    cdr = Float64ArrayCdr(len(data))
    message = deserialize_message(cdr.pack(data), Float64MultiArray)
    np.testing.assert_array_equal(message.data, data)
    assert (message.layout.dim, message.layout.data_offset) == ([], 0)
    payload = serialize_message(Float64MultiArray(data=data))
    np.testing.assert_array_equal(cdr.unpack(payload), data)


def test_other_layouts_are_not_decoded() -> None:
    cdr = Float64ArrayCdr(3)
    labelled = Float64MultiArray(data=[1.0, 2.0, 3.0])
    labelled.layout.dim = [MultiArrayDimension(label='motor', size=3, stride=3)]
    assert cdr.unpack(serialize_message(labelled)) is None
    assert cdr.unpack(serialize_message(Float64MultiArray(data=[1.0, 2.0]))) is None
    assert cdr.unpack(cdr.pack([1, 2, 3])[:-1]) is None
    assert cdr.unpack(b'\0\0' + cdr.pack([1, 2, 3])[2:]) is None


def test_refuses_wrong_lengths() -> None:
    with pytest.raises(ValueError, match='3 numbers'):
        Float64ArrayCdr(3).pack([1.0])
    with pytest.raises(ValueError, match='at least one'):
        Float64ArrayCdr(0)
