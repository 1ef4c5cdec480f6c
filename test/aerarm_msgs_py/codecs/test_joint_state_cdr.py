import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
text = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=12)
names_lists = st.lists(text, min_size=1, max_size=7, unique=True)
stamps = st.integers(0, 2**31 * 10**9 - 1)
numbers = st.floats(allow_nan=True, width=64)


@st.composite
def samples(draw):
    """Draw names, frame, stamp and three fields that are None or full."""
    names = draw(names_lists)
    full = st.lists(numbers, min_size=len(names), max_size=len(names)).map(np.array)
    fields = [draw(st.none() | full) for _ in range(3)]
    return names, draw(text), draw(stamps), fields


def message_of(names, frame_id, stamp_ns, fields) -> JointState:
    message = JointState(name=list(names))
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    for field, values in zip(('position', 'velocity', 'effort'), fields, strict=True):
        setattr(message, field, [] if values is None else values.tolist())
    return message


def assert_same_fields(found, expected) -> None:
    for a, b in zip(found, expected, strict=True):
        assert (a is None) == (b is None)
        if b is not None:
            np.testing.assert_array_equal(a, b)


@given(samples())
def test_the_rclpy_codec_reads_packed_messages(sample) -> None:
    names, frame_id, stamp_ns, fields = sample
    payload = JointStateCdr(names, frame_id).pack(stamp_ns, *fields)
    message = deserialize_message(payload, JointState)
    assert message.header.frame_id == frame_id
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns
    assert message.name == names
    for found, values in zip(
        (message.position, message.velocity, message.effort), fields, strict=True
    ):
        np.testing.assert_array_equal(found, [] if values is None else values)


@given(samples())
def test_reads_messages_of_the_rclpy_codec(sample) -> None:
    names, frame_id, stamp_ns, fields = sample
    payload = serialize_message(message_of(names, frame_id, stamp_ns, fields))
    found = JointStateCdr(names, frame_id).unpack(payload)
    assert found is not None
    assert found.stamp_ns == stamp_ns
    assert_same_fields(found[1:], fields)


@given(samples(), samples())
def test_never_takes_a_message_of_other_joints_for_its_own(one, other) -> None:
    names, frame_id, *_ = one
    payload = serialize_message(message_of(*other))
    found = JointStateCdr(names, frame_id).unpack(payload)
    assert (found is not None) == (names == other[0] and frame_id == other[1])


@given(st.binary(max_size=300))
def test_random_bytes_are_no_message(data: bytes) -> None:
    assert JointStateCdr(NAMES).unpack(data) is None


def test_layouts_may_alternate() -> None:
    cdr = JointStateCdr(NAMES)
    q = np.arange(4.0)
    payloads = [cdr.pack(1, q, None, q), cdr.pack(2, None, q, None), cdr.pack(3, q, q, q)] * 2
    found = [cdr.unpack(payload) for payload in payloads]
    assert [sample.stamp_ns for sample in found] == [1, 2, 3, 1, 2, 3]
    assert_same_fields(found[1][1:], (None, q, None))


@pytest.mark.parametrize(
    'change',
    [
        lambda message: message.name.reverse(),
        lambda message: message.name.pop(),
        lambda message: message.position.pop(),
        lambda message: message.effort.append(1.0),
        lambda message: setattr(message.header, 'frame_id', 'world'),
    ],
    ids=['order', 'joints', 'short', 'long', 'frame'],
)
def test_other_layouts_are_left_to_the_ordinary_codec(change) -> None:
    message = message_of(NAMES, '', 5, [np.ones(4)] * 3)
    change(message)
    assert JointStateCdr(NAMES).unpack(serialize_message(message)) is None


def test_big_endian_and_cut_messages_are_left_to_the_ordinary_codec() -> None:
    cdr = JointStateCdr(NAMES)
    payload = cdr.pack(5, *[np.ones(4)] * 3)
    assert cdr.unpack(b'\0\0' + payload[2:]) is None
    for size in range(len(payload)):
        assert cdr.unpack(payload[:size]) is None


def test_padding_and_bytes_behind_the_message_do_not_matter() -> None:
    cdr = JointStateCdr(('a', 'bc'))
    payload = bytearray(cdr.pack(5, [1.0, 2.0], None, None))
    payload[17:20] = b'xyz'  # behind the empty frame_id
    payload[2:4] = struct.pack('<H', 7)  # encapsulation options
    sample = cdr.unpack(bytes(payload) + b'junk')
    np.testing.assert_array_equal(sample.position, [1.0, 2.0])
    rows = np.frombuffer(bytes(payload) * 3, np.uint8).reshape(3, -1)
    np.testing.assert_array_equal(cdr.unpack_rows(rows)[2][:, 0], [[1.0, 2.0]] * 3)


@given(samples(), st.integers(1, 5))
def test_a_block_is_its_messages(sample, count: int) -> None:
    names, frame_id, stamp_ns, fields = sample
    cdr = JointStateCdr(names, frame_id)
    stamps_ns = [(stamp_ns + k) % (2**31 * 10**9) for k in range(count)]
    data = b''.join(cdr.pack(stamp, *fields) for stamp in stamps_ns)
    mine, found_ns, values = cdr.unpack_rows(np.frombuffer(data, np.uint8).reshape(count, -1))
    assert mine.all()
    assert found_ns.tolist() == stamps_ns
    expected = [np.full(len(names), np.nan) if x is None else x for x in fields]
    np.testing.assert_array_equal(values, [expected] * count)


def test_of_a_block_with_strangers_the_others_are_decoded() -> None:
    cdr, other = JointStateCdr(('a', 'b')), JointStateCdr(('a', 'c'))
    payloads = (
        cdr.pack(1, [1.0, 2.0]),
        other.pack(2, [3.0, 4.0]),
        cdr.pack(3, None, [5.0, 6.0]),
        b'\0\0' + cdr.pack(4, [7.0, 8.0])[2:],  # of the other byte order
    )
    size = max(map(len, payloads))
    data = b''.join(payload.ljust(size, b'\0') for payload in payloads)
    rows = np.frombuffer(data, np.uint8).reshape(4, -1)
    mine, stamp_ns, values = cdr.unpack_rows(rows)
    assert mine.tolist() == [True, False, True, False]
    assert stamp_ns.tolist() == [1, 3]
    np.testing.assert_array_equal(values[:, 0], [[1.0, 2.0], [np.nan, np.nan]])
    np.testing.assert_array_equal(values[:, 1], [[np.nan, np.nan], [5.0, 6.0]])
    mine, _, values = cdr.unpack_rows(rows[1:2])
    assert (mine.tolist(), len(values)) == ([False], 0)


def test_refuses_wrong_lengths_and_names() -> None:
    with pytest.raises(ValueError, match='pass 4 values'):
        JointStateCdr(NAMES).pack(0, [1.0])
    with pytest.raises(ValueError, match='repeated'):
        JointStateCdr(['a', 'a'])
    with pytest.raises(ValueError, match='names'):
        JointStateCdr([])
