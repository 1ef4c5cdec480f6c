import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py.codecs.joint_state_cdr import (
    JointSample,
    decode_as_sent,
    decode_joint_state,
    in_order,
)

SAMPLE = JointSample(5_000_000_007, np.array([1.0, 2.0]), None, np.array([3.0, 4.0]))
NAMES = ('a', 'b')


def test_the_bytes_of_a_message_are_read() -> None:
    message = JointState(name=NAMES, position=SAMPLE.position, effort=SAMPLE.effort)
    message.header.stamp.sec, message.header.stamp.nanosec = 5, 7
    message.header.frame_id = 'any'
    names, sample = decode_joint_state(serialize_message(message))
    assert names == NAMES
    assert sample.stamp_ns == SAMPLE.stamp_ns
    np.testing.assert_array_equal(sample.position, SAMPLE.position)
    assert sample.velocity is None
    np.testing.assert_array_equal(sample.effort, SAMPLE.effort)


def test_joints_are_ordered_by_name() -> None:
    sample = in_order(NAMES, SAMPLE, ['b', 'a'])
    np.testing.assert_array_equal(sample.position, [2.0, 1.0])
    assert sample.velocity is None
    np.testing.assert_array_equal(in_order(NAMES, SAMPLE, ['b']).effort, [4.0])
    with pytest.raises(ValueError, match=r"\['c'\] are missing"):
        in_order(NAMES, SAMPLE, ['a', 'c'])


def test_fields_of_a_wrong_length_are_rejected_or_returned_unchanged() -> None:
    message = JointState(name=['a', 'b'], position=[1.0])
    names, sample = decode_as_sent(serialize_message(message))
    assert names == NAMES
    np.testing.assert_array_equal(sample.position, [1.0])
    assert sample.velocity is None
    with pytest.raises(ValueError, match='2 names, but 1 positions'):
        decode_joint_state(serialize_message(message))
    for decode in (decode_joint_state, decode_as_sent):
        with pytest.raises(ValueError, match='too early'):
            decode(b'\0\1\0\0abc')
