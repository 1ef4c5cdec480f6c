"""Conversion of JointState messages of any layout to samples and back."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from aerarm_msgs_py.codecs.cdr import (
    CdrReader,
)
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample

_NANOSECONDS = 1_000_000_000


def decode_joint_state(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return names and numbers of a serialized JointState of any layout and byte order.

    Raises
    ------
    ValueError
        If the payload is not a JointState, or a field that is not empty does not have one number
        per name.
    """
    return _checked(*decode_as_sent(payload))


def decode_as_sent(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return names and numbers of a JointState, including fields of a wrong length.

    For callers that check the lengths themselves. Raises ValueError if the payload is not a
    JointState.
    """
    reader = CdrReader(payload)
    stamp_ns = reader.int32() * _NANOSECONDS + reader.uint32()
    reader.string()  # frame_id
    names = tuple(reader.strings())
    return names, _sample(stamp_ns, [reader.doubles() for _ in range(3)])


def from_message(message: JointState) -> tuple[tuple[str, ...], JointSample]:
    """Return names and numbers of a message object; raises like `decode_joint_state`."""
    stamp = message.header.stamp
    names = tuple(message.name)
    fields = [np.array(x) for x in (message.position, message.velocity, message.effort)]
    return _checked(names, _sample(stamp.sec * _NANOSECONDS + stamp.nanosec, fields))


def to_message(names: Sequence[str], sample: JointSample) -> JointState:
    """Return a JointState message object; None becomes an empty field."""
    message = JointState(name=list(names))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(sample.stamp_ns, _NANOSECONDS)
    for field in ('position', 'velocity', 'effort'):
        values = getattr(sample, field)
        if values is not None:
            setattr(message, field, np.asarray(values, float).tolist())
    return message


def in_order(names: Sequence[str], sample: JointSample, wanted: Sequence[str]) -> JointSample:
    """Return the numbers of selected joints in a given order.

    Raises
    ------
    ValueError
        If a joint is missing.
    """
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ValueError(f'joints {missing} are missing from {list(names)}: check the joint names')
    order = [list(names).index(name) for name in wanted]
    return JointSample(
        sample.stamp_ns, *(None if field is None else field[order] for field in sample[1:])
    )


def _sample(stamp_ns: int, fields: Sequence[NDArray[np.float64]]) -> JointSample:
    return JointSample(stamp_ns, *(field if len(field) else None for field in fields))


def _checked(names: tuple[str, ...], sample: JointSample) -> tuple[tuple[str, ...], JointSample]:
    lengths = [0 if field is None else len(field) for field in sample[1:]]
    if any(length not in (0, len(names)) for length in lengths):
        raise ValueError(
            f'the message has {len(names)} names, but {lengths[0]} positions, {lengths[1]} '
            f'velocities and {lengths[2]} efforts: each array must be empty or have one number '
            'per name'
        )
    return names, sample
