"""Fast codec of serialized sensor_msgs/JointState messages with constant joint names.

With constant joint names, a serialized JointState has a fixed layout. A 1 kHz loop therefore reads
and writes the numbers at fixed offsets, which takes 2 us instead of 30 us with message objects.
Standard: OMG DDSI-RTPS 2.3, section 10 (CDR, little-endian).
"""

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerarm_msgs_py.codecs.cdr import (
    ENCAPSULATION_SIZE,
    LITTLE_ENDIAN,
    CdrPrefix,
    CdrReader,
    Payloads,
)


class JointSample(NamedTuple):
    """Time stamp and values of one JointState message, in the joint order of its publisher.

    Attributes
    ----------
    stamp_ns
        `header.stamp` [ns].
    position, velocity, effort
        (n,) values of the joints [rad], [rad/s], [Nm]; None for an empty field.
    """

    stamp_ns: int
    position: NDArray[np.float64] | None
    velocity: NDArray[np.float64] | None
    effort: NDArray[np.float64] | None


_STAMP = struct.Struct('<iI')
_STAMP_OFFSET = ENCAPSULATION_SIZE
_PREFIX_OFFSET = _STAMP_OFFSET + _STAMP.size
_STAMP_FIELDS = np.dtype([('sec', '<i4'), ('nanosec', '<u4')])
_COUNT = struct.Struct('<I')
_DOUBLES = np.dtype('<f8')
_NANOSECONDS = 1_000_000_000


class JointStateLayout:
    """Offsets of stamp, position, velocity and effort in a serialized JointState.

    The offsets depend on which of the three fields are empty. A field consists of a count (4 bytes)
    and the numbers, which are aligned to 8 bytes from the end of the encapsulation.

    Parameters
    ----------
    prefix
        Fields of the message between its stamp and the count of the first field.
    n
        Number of joints.
    full
        Which of position, velocity and effort have n numbers; the others are empty.

    Attributes
    ----------
    size
        Size of the message up to the end of the last field [bytes].
    """

    def __init__(self, prefix: CdrPrefix, n: int, full: tuple[bool, ...]) -> None:
        self._n = n
        self._counts = tuple(n * is_full for is_full in full)
        self._offsets: list[int | None] = []
        content, mask = bytearray(prefix.end), bytearray(prefix.end)
        content[:2], mask[:2] = LITTLE_ENDIAN, b'\xff\xff'
        content[prefix.start :], mask[prefix.start :] = prefix.content, prefix.mask
        numbers, end = f'<{_STAMP_OFFSET}xiI', _PREFIX_OFFSET  # the stamp, then each count
        for count, is_full in zip(self._counts, full, strict=True):
            numbers += f'{len(content) - end}xI'
            content += _COUNT.pack(count)
            mask += b'\xff' * _COUNT.size
            end = len(content)
            padding = -(end - ENCAPSULATION_SIZE) % 8 if is_full else 0
            self._offsets.append(end + padding if is_full else None)
            content += bytes(padding + _DOUBLES.itemsize * count)
            mask += bytes(len(content) - len(mask))
        self.size = len(content)
        self._numbers = struct.Struct(numbers)
        self._content, self._mask = (np.frombuffer(part, np.uint8) for part in (content, mask))

    def sample(self, payload: bytes) -> JointSample | None:
        """Return stamp and views of the fields of a payload; None if it has another layout."""
        if len(payload) < self.size:
            return None
        numbers = self._numbers.unpack_from(payload)
        if numbers[2:] != self._counts:
            return None
        fields = [
            None if offset is None else np.frombuffer(payload, _DOUBLES, self._n, offset)
            for offset in self._offsets
        ]
        return JointSample(numbers[0] * _NANOSECONDS + numbers[1], *fields)

    def matching_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of M payloads, the rows of an (M, size) array, have this layout."""
        if rows.shape[1] < self.size:
            return np.zeros(len(rows), bool)
        return np.asarray((rows[:, : self.size] & self._mask == self._content).all(1))

    def read_rows(self, rows: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return stamps (M,) [ns] and values (M, 3, n) of M payloads of this layout.

        Values of empty fields are NaN.
        """
        stamps = rows[:, _STAMP_OFFSET:_PREFIX_OFFSET].copy().view(_STAMP_FIELDS)[:, 0]
        values = np.full((len(rows), len(self._offsets), self._n), np.nan)
        for k, offset in enumerate(self._offsets):
            if offset is not None:
                numbers = rows[:, offset : offset + _DOUBLES.itemsize * self._n]
                values[:, k] = numbers.copy().view(_DOUBLES)
        return stamps['sec'].astype(np.int64) * _NANOSECONDS + stamps['nanosec'], values

    def template(self) -> tuple[bytearray, list[NDArray[np.float64]]]:
        """Return a payload without stamp and values, and writable views of its fields."""
        buffer = bytearray(self._content)
        return buffer, [
            np.empty(0) if offset is None else np.frombuffer(buffer, _DOUBLES, self._n, offset)
            for offset in self._offsets
        ]


class JointStateCdr:
    """Codec of JointState messages of one arm, whose joint names are constant.

    Position, velocity and effort may each be empty or have one number per joint, which gives eight
    layouts. If a message has other names, another order, frame, length or byte order, `unpack`
    returns None, and the caller must use `decode_joint_state`, or `decode_as_sent` if it checks
    the lengths itself.

    Parameters
    ----------
    names
        Names of the n joints in the order of the numbers.
    frame_id
        `header.frame_id` of every message.

    Raises
    ------
    ValueError
        If there are no names, or a name is repeated.
    """

    def __init__(self, names: Sequence[str], frame_id: str = '') -> None:
        self.names = tuple(names)
        if not self.names or len(set(self.names)) != len(self.names):
            raise ValueError(f'joint names must not be empty or repeated: check {list(names)}')
        self.frame_id = frame_id
        self._prefix = CdrPrefix(_PREFIX_OFFSET, frame_id, self.names)
        self._layouts = {
            full: JointStateLayout(self._prefix, len(self.names), full)
            for full in product((True, False), repeat=3)
        }
        # In most streams the layout does not change, so the last layout is tried first.
        self._recent = self._layouts[(True, True, True)]
        self._buffers = {full: layout.template() for full, layout in self._layouts.items()}

    def pack(
        self,
        stamp_ns: int,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
    ) -> bytes:
        """Serialize one JointState message.

        Parameters
        ----------
        stamp_ns
            `header.stamp` [ns].
        position, velocity, effort
            (n,) values of the joints [rad], [rad/s], [Nm]; None for an empty field.

        Returns
        -------
        bytes
            Payload for `Publisher.publish`.

        Raises
        ------
        ValueError
            If an array does not have n numbers.
        """
        full = (position is not None, velocity is not None, effort is not None)
        buffer, views = self._buffers[full]
        _STAMP.pack_into(buffer, _STAMP_OFFSET, *divmod(stamp_ns, _NANOSECONDS))
        for view, values in zip(views, (position, velocity, effort), strict=True):
            if values is not None:
                if getattr(values, 'shape', None) != view.shape and np.shape(values) != view.shape:
                    raise ValueError(
                        f'position, velocity or effort has the shape {np.shape(values)}: pass '
                        f'{len(self.names)} values, one per joint of {self.names}'
                    )
                view[:] = values
        return bytes(buffer)

    def unpack(self, payload: bytes) -> JointSample | None:
        """Decode one JointState message.

        Returns
        -------
        JointSample or None
            Stamp, and numbers as read-only views of `payload`; None if the message has another
            layout.
        """
        if not self._prefix.matches(payload):
            return None
        sample = self._recent.sample(payload)
        if sample is None:
            for layout in self._layouts.values():
                if (sample := layout.sample(payload)) is not None:
                    self._recent = layout
                    break
        return sample


# Indices of the messages, (k, 3, m) numbers, and the columns of the m joints.
_Decoded = tuple[NDArray[np.intp], NDArray[np.float64], list[int]]

_LEARNT_LAYOUTS = 64  # limit per topic, because learning one and each comparison take time
_MOST_JOINTS = 256  # limit per topic, more than any robot has, because memory is limited
_LONGEST_NAME = 255  # characters
_LONGEST_PREFIX = 2**14  # longest names prefix to learn, in bytes


class JointStateDecoder:
    """Decoder of JointState messages with any joint names, block by block.

    Messages with equal names, frame and lengths are decoded together, other messages one by one.
    Each joint name has a column in the result, also in later blocks.

    Attributes
    ----------
    names
        Joint names of all messages so far, in the order of the columns.
    irregular
        Number of ignored fields whose length was neither 0 nor that of the names.
    singly
        Number of messages that were decoded one by one, which takes a hundred times as long.
    """

    def __init__(self) -> None:
        self.names: list[str] = []
        self.irregular = 0
        self.singly = 0
        self._layouts: dict[tuple[str, tuple[str, ...], tuple[bool, ...]], JointStateLayout] = {}

    def decode(self, payloads: Payloads) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Decode K JointState messages.

        Returns
        -------
        stamp_ns : (K,) `header.stamp` [ns]
        values : (K, 3, n) position, velocity, effort [rad, rad/s, Nm] of all joints so far; NaN if
            missing

        Raises
        ------
        ValueError
            If a payload is not a JointState, contains a joint name twice, or has too many joints.
        """
        stamp_ns = np.zeros(len(payloads), np.int64)
        decoded = [
            part
            for index in payloads.groups_of_size()
            for part in self._decode_group(payloads, index, stamp_ns)
        ]
        if len(decoded) == 1 and decoded[0][2] == list(range(len(self.names))):
            return stamp_ns, decoded[0][1]
        values = np.full((len(payloads), 3, len(self.names)), np.nan)
        for index, numbers, columns in decoded:
            values[index[:, None], :, columns] = numbers.transpose(0, 2, 1)
        return stamp_ns, values

    def _decode_group(
        self, payloads: Payloads, left: NDArray[np.intp], stamp_ns: NDArray[np.int64]
    ) -> Iterator[_Decoded]:
        """Decode messages of equal size, and yield their values in groups of equal layout."""
        while len(left):
            payload = payloads[int(left[0])]
            stamp, frame_id, names, fields = _read(payload)
            self._check_names(names)
            columns = [self._column(name) for name in names]
            layout = self._layout(payload, frame_id, names, fields)
            if layout is None:
                found, left = left[:1], left[1:]
                stamp_ns[found] = stamp
                yield found, self._numbers(fields, len(names))[None], columns
            else:
                rows = payloads.rows(left)
                same = layout.matching_rows(rows)
                found, left = left[same], left[~same]
                stamp_ns[found], values = layout.read_rows(rows[same])
                yield found, values, columns

    def _numbers(self, fields: list[NDArray[np.float64]], n: int) -> NDArray[np.float64]:
        """Return the values (3, n) of a message; NaN for fields of another length."""
        self.singly += 1
        numbers = np.full((len(fields), n), np.nan)
        for row, field in zip(numbers, fields, strict=True):
            if len(field) == n:
                row[:] = field
            else:
                self.irregular += len(field) > 0
        return numbers

    def _layout(
        self, payload: bytes, frame_id: str, names: list[str], fields: list[NDArray[np.float64]]
    ) -> JointStateLayout | None:
        """Return the layout of a message; None if the message must be decoded separately."""
        short = len(frame_id) + sum(map(len, names)) < _LONGEST_PREFIX
        is_regular = all(len(field) in (0, len(names)) for field in fields)
        if not (names and short and is_regular and payload.startswith(LITTLE_ENDIAN)):
            return None
        key = frame_id, tuple(names), tuple(len(field) > 0 for field in fields)
        if key not in self._layouts and len(self._layouts) < _LEARNT_LAYOUTS:
            self.singly += 1
            prefix = CdrPrefix(_PREFIX_OFFSET, frame_id, names)
            self._layouts[key] = JointStateLayout(prefix, len(names), key[2])
        layout = self._layouts.get(key)
        # A text that is damaged, or does not end with a zero, differs from its decoded form.
        row = np.frombuffer(payload, np.uint8)[None]
        return layout if layout is not None and layout.matching_rows(row)[0] else None

    def _check_names(self, names: list[str]) -> None:
        if len(names) > _MOST_JOINTS:
            raise ValueError(f'a message names {len(names)} joints, more than {_MOST_JOINTS}')
        if any(len(name) > _LONGEST_NAME for name in names):
            raise ValueError(f'a message has a joint name of more than {_LONGEST_NAME} characters')
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise ValueError(
                f'a message names joint {", ".join(repeated)} more than once: check the joint '
                'names of its publisher'
            )

    def _column(self, name: str) -> int:
        if name not in self.names:
            if len(self.names) == _MOST_JOINTS:
                raise ValueError(f'the messages name more than {_MOST_JOINTS} joints')
            self.names.append(name)
        return self.names.index(name)


def decode_joint_state(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return joint names and values of a serialized JointState, whatever its layout and byte order.

    Raises
    ------
    ValueError
        If the payload is not a JointState, or if a field is neither empty nor has one number per
        name.
    """
    names, sample = decode_as_sent(payload)
    lengths = [0 if field is None else len(field) for field in sample[1:]]
    if any(length not in (0, len(names)) for length in lengths):
        raise ValueError(
            f'the message has {len(names)} names, but {lengths[0]} positions, {lengths[1]} '
            f'velocities and {lengths[2]} efforts: each array must be empty or have one number '
            'per name'
        )
    return names, sample


def decode_as_sent(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return joint names and values of a JointState without checking the fields' lengths.

    Raises ValueError if the payload is not a JointState.
    """
    stamp_ns, _, names, fields = _read(payload)
    return tuple(names), JointSample(stamp_ns, *(x if len(x) else None for x in fields))


def _read(payload: bytes) -> tuple[int, str, list[str], list[NDArray[np.float64]]]:
    """Return stamp [ns], frame, names and the three fields of a JointState."""
    reader = CdrReader(payload)
    stamp_ns = reader.int32() * _NANOSECONDS + reader.uint32()
    return stamp_ns, reader.string(), reader.strings(), [reader.doubles() for _ in range(3)]


def in_order(names: Sequence[str], sample: JointSample, wanted: Sequence[str]) -> JointSample:
    """Return the values of the joints `wanted`, in this order.

    Raises
    ------
    ValueError
        If a joint is missing.
    """
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ValueError(
            f'joints {missing} are missing from the message with the joints {list(names)}: check '
            'the joint names'
        )
    order = [list(names).index(name) for name in wanted]
    return JointSample(
        sample.stamp_ns, *(None if field is None else field[order] for field in sample[1:])
    )
