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
def test_agrees_with_the_rclpy_codec(sample) -> None:
    names, frame_id, stamp_ns, fields = sample
    codec, message = JointStateCdr(names, frame_id), message_of(*sample)
    packed = deserialize_message(codec.pack(stamp_ns, *fields), JointState)
    assert str(packed) == str(message)  # NaN is not equal to itself
    for payload in (serialize_message(message), codec.pack(stamp_ns, *fields)) * 2:
        found = codec.unpack(payload)
        assert found is not None
        assert found.stamp_ns == stamp_ns
        assert_same_fields(found[1:], fields)


@given(samples(), samples())
def test_never_takes_a_message_of_other_joints_for_its_own(one, other) -> None:
    names, frame_id, *_ = one
    payload = serialize_message(message_of(*other))
    found = JointStateCdr(names, frame_id).unpack(payload)
    assert (found is not None) == (names == other[0] and frame_id == other[1])


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
    other = cdr.pack(6, [3.0, 4.0]).ljust(len(payload) + 4, b'?')
    decoder = JointStateDecoder()
    _, values = decoder.decode(Payloads.of([bytes(payload) + b'junk', other]))
    np.testing.assert_array_equal(values[:, 0], [[1.0, 2.0], [3.0, 4.0]])
    assert decoder.singly == 1  # decoded together


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


def test_wrong_lengths_and_names_are_rejected() -> None:
    payload = serialize_message(JointState(name=['a', 'b'], position=[1.0]))
    names, sample = decode_as_sent(payload)
    assert names == ('a', 'b')
    assert_same_fields(sample[1:], ([1.0], None, None))
    for call, said in (
        (lambda: decode_joint_state(payload), '2 names, but 1 positions'),
        (lambda: decode_joint_state(b'\0\1\0\0abc'), 'too early'),
        (lambda: decode_as_sent(b'\0\1\0\0abc'), 'too early'),
        (lambda: JointStateCdr(NAMES).pack(0, [1.0]), 'pass 4 values'),
        (lambda: JointStateCdr(['a', 'a']), 'repeated'),
    ):
        with pytest.raises(ValueError, match=said):
            call()


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


def test_names_that_are_no_proper_texts_are_decoded_one_by_one() -> None:
    payload = JointStateCdr(['ab']).pack(5, [1.0])
    for damaged in (payload.replace(b'ab\0', b'abc'), payload.replace(b'ab\0', b'\xffb\0')):
        decoder = JointStateDecoder()
        stamp_ns, values = decoder.decode(Payloads.of([damaged, payload, damaged]))
        assert stamp_ns.tolist() == [5] * 3
        assert np.nansum(values, axis=2)[:, 0].tolist() == [1.0] * 3
