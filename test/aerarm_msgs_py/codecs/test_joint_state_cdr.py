import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import (
    JointStateCdr,
    JointStateDecoder,
    decode_as_sent,
    decode_joint_state,
    in_order,
)

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
text = st.text('aj1_ \u00e9\u4e2d\U0001f916', max_size=12)
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


def test_layouts_may_alternate() -> None:
    cdr = JointStateCdr(NAMES)
    q = np.arange(4.0)
    payloads = [cdr.pack(1, q, None, q), cdr.pack(2, None, q, None), cdr.pack(3, q, q, q)] * 2
    found = [cdr.unpack(payload) for payload in payloads]
    assert [sample.stamp_ns for sample in found] == [1, 2, 3, 1, 2, 3]
    assert_same_fields(found[1][1:], (None, q, None))


def test_other_layouts_are_left_to_the_ordinary_codec() -> None:
    cdr = JointStateCdr(NAMES)
    for change in (
        lambda message: message.name.reverse(),
        lambda message: message.name.pop(),
        lambda message: message.position.pop(),
        lambda message: message.effort.append(1.0),
        lambda message: setattr(message.header, 'frame_id', 'world'),
    ):
        message = message_of(NAMES, '', 5, [np.ones(4)] * 3)
        change(message)
        assert cdr.unpack(serialize_message(message)) is None
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


def test_joints_are_ordered_by_name() -> None:
    message = JointState(name=['a', 'b'], position=[1.0, 2.0], effort=[3.0, 4.0])
    message.header.stamp.sec, message.header.stamp.nanosec = 5, 7
    message.header.frame_id = 'any'
    names, sample = decode_joint_state(serialize_message(message))
    assert (names, sample.stamp_ns) == (('a', 'b'), 5_000_000_007)
    ordered = in_order(names, sample, ['b', 'a'])
    assert_same_fields(ordered[1:], ([2.0, 1.0], None, [4.0, 3.0]))
    np.testing.assert_array_equal(in_order(names, sample, ['b']).effort, [4.0])
    with pytest.raises(ValueError, match=r"\['c'\] are missing"):
        in_order(names, sample, ['a', 'c'])


def test_fields_of_a_wrong_length_are_rejected_or_returned_unchanged() -> None:
    payload = serialize_message(JointState(name=['a', 'b'], position=[1.0]))
    names, sample = decode_as_sent(payload)
    assert names == ('a', 'b')
    assert_same_fields(sample[1:], ([1.0], None, None))
    with pytest.raises(ValueError, match='2 names, but 1 positions'):
        decode_joint_state(payload)
    for decode in (decode_joint_state, decode_as_sent):
        with pytest.raises(ValueError, match='too early'):
            decode(b'\0\1\0\0abc')


ARMS = [JointStateCdr(names, frame) for names in (['a', 'b'], ['b', 'a'], ['a', 'bb', 'c'])
        for frame in ('', 'base')]  # fmt: skip


@given(st.lists(st.tuples(st.sampled_from(ARMS), st.integers(0, 7)), min_size=1, max_size=30))
def test_a_mixture_is_decoded_message_by_message(kinds) -> None:
    rng = np.random.default_rng(len(kinds))
    payloads, expected = [], []
    for k, (codec, full) in enumerate(kinds):
        values = rng.normal(size=(3, len(codec.names)))
        fields = [x if full >> i & 1 else None for i, x in enumerate(values)]
        payloads.append(codec.pack(k, *fields))
        expected.append((codec.names, fields))
    decoder = JointStateDecoder()
    stamp_ns, values = decoder.decode(Payloads.of(payloads))
    assert stamp_ns.tolist() == list(range(len(kinds)))
    for row, (names, fields) in zip(values, expected, strict=True):
        columns = [decoder.names.index(name) for name in names]
        for found, field in zip(row[:, columns], fields, strict=True):
            np.testing.assert_array_equal(found, np.nan if field is None else field)
        others = [k for k in range(len(decoder.names)) if k not in columns]
        assert np.isnan(row[:, others]).all()


def test_big_endian_messages() -> None:
    body = struct.pack('>iI', 3, 4) + struct.pack('>I4s', 1, b'\0???')
    body += struct.pack('>II2s2x', 1, 2, b'a\0')  # one name
    body += struct.pack('>Id', 1, 1.5) + struct.pack('>I4xd', 1, 2.5) + struct.pack('>I', 0)
    stamp_ns, values = JointStateDecoder().decode(Payloads.of([b'\0\0\0\0' + body] * 2))
    assert stamp_ns.tolist() == [3_000_000_004] * 2
    np.testing.assert_array_equal(values, [[[1.5], [2.5], [np.nan]]] * 2)
