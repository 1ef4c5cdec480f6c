"""Fast codec of serialized sensor_msgs/JointState messages with constant joint names.

With constant joint names, a serialized JointState has a fixed layout. A 1 kHz loop therefore reads
and writes the numbers at fixed offsets, which takes 2 us instead of 30 us with message objects.
Standard: OMG DDSI-RTPS 2.3, section 10 (CDR, little-endian).
"""

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

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
_FIELDS = ('position', 'velocity', 'effort')
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
        self.size = prefix.end
        self._prefix, self._n = prefix, n
        self._counts = tuple(n * is_full for is_full in full)
        self._offsets: list[int | None] = []
        kinds: dict[str, tuple[Any, int]] = {
            'sec': ('<i4', _STAMP_OFFSET),
            'nanosec': ('<u4', _STAMP_OFFSET + 4),
        }
        numbers, end = f'<{_STAMP_OFFSET}xiI', _PREFIX_OFFSET  # the stamp, then each count
        for name, is_full in zip(_FIELDS, full, strict=True):
            kinds[f'{name} count'] = ('<u4', self.size)
            numbers += f'{self.size - end}xI'
            end = self.size = self.size + 4
            if is_full:
                self.size += -(self.size - ENCAPSULATION_SIZE) % 8
                kinds[name] = (('<f8', n), self.size)
            self._offsets.append(self.size if is_full else None)
            self.size += 8 * n * is_full
        self._numbers = struct.Struct(numbers)
        self._dtype = np.dtype(kinds)  # type: ignore[call-overload]

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
        records = self._records(rows)
        counts = zip(_FIELDS, self._counts, strict=True)
        same = [records[f'{name} count'] == count for name, count in counts]
        return np.asarray(np.all(same, axis=0))

    def read_rows(
        self,
        rows: NDArray[np.uint8],
        which: slice | NDArray[np.bool_],
        stamp_ns: NDArray[np.int64],
        values: NDArray[np.float64],
    ) -> None:
        """Store stamps (M,) [ns] and values (M, 3, n) of the rows `which`, which have this layout.

        Values of empty fields stay unchanged.
        """
        records = self._records(rows)[which]
        stamp_ns[which] = records['sec'].astype(np.int64) * _NANOSECONDS + records['nanosec']
        for k, (name, count) in enumerate(zip(_FIELDS, self._counts, strict=True)):
            if count:
                values[which, k] = records[name]

    def template(self) -> tuple[bytearray, list[NDArray[np.float64]]]:
        """Return a payload without stamp and values, and writable views of its fields."""
        buffer = bytearray(self.size)
        buffer[:2] = LITTLE_ENDIAN
        buffer[self._prefix.start : self._prefix.end] = self._prefix.content
        (record,) = self._records(np.frombuffer(buffer, np.uint8)[None])
        for name, count in zip(_FIELDS, self._counts, strict=True):
            record[f'{name} count'] = count
        pairs = zip(_FIELDS, self._counts, strict=True)
        return buffer, [record[name] if count else np.empty(0) for name, count in pairs]

    def _records(self, rows: NDArray[np.uint8]) -> NDArray[np.void]:
        return np.asarray(rows[:, : self.size].view(self._dtype)[:, 0])


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

    def unpack_rows(
        self, rows: NDArray[np.uint8]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.float64]]:
        """Decode M messages of equal size at once.

        Parameters
        ----------
        rows
            (M, size) the payloads, one per row.

        Returns
        -------
        mine : (M,) whether each row has a layout of this codec; true for K rows
        stamp_ns : (K,) [ns]
        values : (K, 3, n) position, velocity and effort [rad, rad/s, Nm]; NaN where empty
        """
        left = self._prefix.matching_rows(rows)
        stamp_ns = np.zeros(len(rows), np.int64)
        values = np.full((len(rows), 3, len(self.names)), np.nan)
        mine = np.zeros(len(rows), bool)
        for layout in self._layouts.values():
            if not left.any():
                break
            same = left & layout.matching_rows(rows)
            if same.any():
                layout.read_rows(rows, slice(None) if same.all() else same, stamp_ns, values)
            mine |= same
            left &= ~same
        return (mine, stamp_ns, values) if mine.all() else (mine, stamp_ns[mine], values[mine])


# Indices of the messages, (k, 3, m) numbers, and the columns of the m joints.
_Decoded = tuple[NDArray[np.intp], NDArray[np.float64], list[int]]

_KNOWN_LAYOUTS = 8
_LEARNT_LAYOUTS = 64  # in total, because learning one takes time
_MOST_JOINTS = 256  # limit per topic, more than any robot has, because memory is limited
_LONGEST_NAME = 255  # characters
_LONGEST_PREFIX = 2**14  # longest names prefix to learn, in bytes


class JointStateDecoder:
    """Decoder of JointState messages with any joint names, block by block.

    Messages with equal names, frame and size are decoded together by `JointStateCdr`, other
    messages one by one. Each joint name has a column in the result, also in later blocks.

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
        self._codecs: dict[tuple[tuple[str, ...], str], tuple[JointStateCdr, list[int]]] = {}
        self._learnt = 0

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
        codecs = list(self._codecs.values())
        while len(left):
            for codec, columns in codecs:
                mine, stamps, numbers = codec.unpack_rows(payloads.rows(left))
                if mine.any():
                    found, left = left[mine], left[~mine]
                    stamp_ns[found] = stamps
                    yield found, numbers, columns
            if len(left):
                learnt, first = self._learnt, left[:1]
                stamp_ns[first], numbers, columns = self._decode_one(payloads[int(first[0])])
                yield first, numbers[None], columns
                left = left[1:]
                # The layout of one message usually fits all of the group.
                codecs = list(self._codecs.values())[-1:] if self._learnt > learnt else []

    def _decode_one(self, payload: bytes) -> tuple[int, NDArray[np.float64], list[int]]:
        """Return the stamp [ns] of one message, its values (3, m), and the m columns for them."""
        self.singly += 1
        stamp_ns, frame_id, names, fields = _read(payload)
        self._check_names(names)
        numbers = np.full((3, len(names)), np.nan)
        for row, field in zip(numbers, fields, strict=True):
            if len(field) == len(names):
                row[:] = field
            else:
                self.irregular += len(field) > 0
        columns = [self._column(name) for name in names]
        self._remember(names, frame_id, columns)
        return stamp_ns, numbers, columns

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

    def _remember(self, names: list[str], frame_id: str, columns: list[int]) -> None:
        key = tuple(names), frame_id
        short = len(frame_id) + sum(map(len, names)) < _LONGEST_PREFIX
        if names and short and key not in self._codecs and self._learnt < _LEARNT_LAYOUTS:
            self._learnt += 1
            self._codecs[key] = JointStateCdr(names, frame_id), columns
            if len(self._codecs) > _KNOWN_LAYOUTS:
                del self._codecs[next(iter(self._codecs))]


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
