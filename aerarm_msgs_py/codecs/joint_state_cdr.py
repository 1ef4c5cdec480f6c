"""Fast codec of serialized sensor_msgs/JointState messages with constant joint names.

With constant joint names, a serialized JointState has a fixed layout. A 1 kHz loop therefore reads
and writes the numbers at fixed offsets, which takes 2 us instead of 30 us with message objects.
Standard: OMG DDSI-RTPS 2.3, section 10 (CDR, little-endian).
"""

import struct
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
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


_COUNT = struct.Struct('<I')
_DOUBLE = 8
_DOUBLES = np.dtype('<f8')
_STAMP_SIZE = 8
_NANOSECONDS = 1_000_000_000
_EMPTY = np.empty(0)


class JointStateLayout:
    """Offsets of position, velocity and effort in a serialized JointState.

    The offsets depend on which of the three fields are empty. A field consists of a count (4 bytes)
    and the numbers, which are aligned to 8 bytes from the end of the encapsulation.

    Parameters
    ----------
    start
        Offset of the count of the first field.
    n
        Number of joints.
    full
        Which of position, velocity and effort have n numbers; the others are empty.

    Attributes
    ----------
    size
        Size of the message up to the end of the last field [bytes].
    """

    def __init__(self, start: int, n: int, full: tuple[bool, ...]) -> None:
        self.n = n
        self.full = full
        self._count_offsets: list[int] = []
        self._data_offsets: list[int] = []
        numbers = f'{ENCAPSULATION_SIZE}xiI'  # the stamp, then each count
        end, offset = ENCAPSULATION_SIZE + _STAMP_SIZE, start
        for is_full in full:
            numbers += f'{offset - end}xI'
            self._count_offsets.append(offset)
            end = offset = offset + _COUNT.size
            if is_full:
                offset += -(offset - ENCAPSULATION_SIZE) % _DOUBLE
            self._data_offsets.append(offset)
            offset += n * _DOUBLE * is_full
        self.size = offset
        self._numbers = struct.Struct('<' + numbers)
        self._counts = tuple(n * is_full for is_full in full)
        # Two full fields are separated by a multiple of 8 bytes, so both are slices of one array.
        self._first = self._data_offsets[full.index(True)] if any(full) else self.size
        self._span = (self.size - self._first) // _DOUBLE
        places = [(offset - self._first) // _DOUBLE for offset in self._data_offsets]
        self._parts = [
            slice(place, place + n) if is_full else None
            for place, is_full in zip(places, full, strict=True)
        ]

    def stamp_of(self, payload: bytes) -> int | None:
        """Return the stamp [ns] of a payload; None if its fields do not have this layout."""
        if len(payload) < self.size:
            return None
        numbers = self._numbers.unpack_from(payload)
        if numbers[2:] != self._counts:
            return None
        return int(numbers[0] * _NANOSECONDS + numbers[1])

    def matching_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of M payloads, the rows of an (M, size) array, have this layout."""
        if rows.shape[1] < self.size:
            return np.zeros(len(rows), bool)
        same = np.ones(len(rows), bool)
        for offset, count in zip(self._count_offsets, self._counts, strict=True):
            found = np.ascontiguousarray(rows[:, offset : offset + _COUNT.size])
            same &= found.view('<u4')[:, 0] == count
        return same

    def fields(
        self, payload: bytes
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """Return views of position, velocity and effort (n,) in a payload with this layout."""
        numbers = np.frombuffer(payload, _DOUBLES, self._span, self._first)
        position, velocity, effort = self._parts
        return (
            None if position is None else numbers[position],
            None if velocity is None else numbers[velocity],
            None if effort is None else numbers[effort],
        )

    def values_of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the values (M, 3, n) of M payloads with this layout; NaN for an empty field."""
        values = np.full((len(rows), 3, self.n), np.nan)
        for k, (offset, is_full) in enumerate(zip(self._data_offsets, self.full, strict=True)):
            if is_full:
                data = np.ascontiguousarray(rows[:, offset : offset + self.n * _DOUBLE])
                values[:, k] = data.view('<f8')
        return values

    def write_counts(self, buffer: bytearray) -> None:
        """Write positions, velocities and efforts into the buffer of a payload."""
        for offset, count in zip(self._count_offsets, self._counts, strict=True):
            _COUNT.pack_into(buffer, offset, count)

    def views(self, buffer: bytearray) -> list[NDArray[np.float64]]:
        """Return writable views of position, velocity and effort; size 0 for an empty field."""
        return [
            np.frombuffer(buffer, '<f8', self.n, offset) if is_full else _EMPTY
            for offset, is_full in zip(self._data_offsets, self.full, strict=True)
        ]


_STAMP = struct.Struct('<iI')
_STAMP_OFFSET = ENCAPSULATION_SIZE
_PREFIX_OFFSET = _STAMP_OFFSET + _STAMP.size


class JointStateCdr:
    """Codec of JointState messages of one arm, whose joint names are constant.

    Position, velocity and effort may each be empty or have one number per joint, which gives eight
    layouts. If a message has other names, another order, frame, length or byte order, `unpack`
    returns None, and the caller must use `decode_joint_state`.

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
        self._prefix = CdrPrefix(_PREFIX_OFFSET)
        self._prefix.add_string(frame_id)
        self._prefix.add_strings(self.names)
        self._prefix.align(4)
        self._layouts = {
            full: JointStateLayout(self._prefix.end, len(self.names), full)
            for full in product((False, True), repeat=3)
        }
        # In most streams the layout does not change, so the last layout is tried first.
        self._recent = self._layouts[(True, True, True)]
        self._buffers = {full: self._template(layout) for full, layout in self._layouts.items()}

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
        stamp_ns = self._recent.stamp_of(payload)
        if stamp_ns is None:
            self._recent = self._find_layout(payload) or self._recent
            stamp_ns = self._recent.stamp_of(payload)
        if stamp_ns is None:
            return None
        return JointSample(stamp_ns, *self._recent.fields(payload))

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
        mine = self._prefix.matching_rows(rows)
        if not mine.any():  # rows may be too short to contain a stamp
            return mine, np.empty(0, np.int64), np.empty((0, 3, len(self.names)))
        whole = self._find_layout(rows[0].tobytes()) if mine.all() else None
        if whole is not None and whole.matching_rows(rows).all():  # as nearly always
            return mine, _stamps(rows), whole.values_of_rows(rows)
        left = np.flatnonzero(mine)
        values = np.full((len(rows), 3, len(self.names)), np.nan)
        for layout in self._layouts_of(rows, left):
            same = layout.matching_rows(rows if len(left) == len(rows) else rows[left])
            if same.any():
                found = left[same]
                values[found] = layout.values_of_rows(rows[found])
                left = left[~same]
        mine[left] = False
        return mine, _stamps(rows[mine]), values[mine]

    def _layouts_of(
        self, rows: NDArray[np.uint8], index: NDArray[np.intp]
    ) -> Iterator[JointStateLayout]:
        """Yield all layouts, first the layout of the first row."""
        if not len(index):
            return
        first = self._find_layout(rows[index[0]].tobytes())
        if first is not None:
            yield first
        yield from (x for x in self._layouts.values() if x is not first)

    def _find_layout(self, payload: bytes) -> JointStateLayout | None:
        layouts = self._layouts.values()
        return next((x for x in layouts if x.stamp_of(payload) is not None), None)

    def _template(self, layout: JointStateLayout) -> tuple[bytearray, list[NDArray[np.float64]]]:
        """Return the buffer of a payload, and writable views of its values."""
        buffer = bytearray(layout.size)
        buffer[:2] = LITTLE_ENDIAN
        buffer[self._prefix.start : self._prefix.end] = self._prefix.content
        layout.write_counts(buffer)
        return buffer, layout.views(buffer)


def _stamps(rows: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the stamps [ns] of M payloads, the rows of an (M, size) array."""
    stamp = np.ascontiguousarray(rows[:, _STAMP_OFFSET:_PREFIX_OFFSET])
    seconds = stamp.view('<i4')[:, 0].astype(np.int64)
    return np.asarray(seconds * _NANOSECONDS + stamp.view('<u4')[:, 1])


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
        self._columns: dict[str, int] = {}
        self._codecs: list[tuple[JointStateCdr, list[int]]] = []
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
        decoded: list[_Decoded] = []
        for index in payloads.groups_of_size():
            decoded += self._decode_group(payloads, index, stamp_ns)
        if len(decoded) == 1 and decoded[0][2] == list(range(len(self.names))):
            return stamp_ns, decoded[0][1]
        values = np.full((len(payloads), 3, len(self.names)), np.nan)
        for index, numbers, columns in decoded:
            values[index[:, None], :, columns] = numbers.transpose(0, 2, 1)
        return stamp_ns, values

    def _decode_group(
        self, payloads: Payloads, index: NDArray[np.intp], stamp_ns: NDArray[np.int64]
    ) -> Iterator[_Decoded]:
        """Decode messages of equal size, and yield their values in groups of equal layout."""
        rows = payloads.rows(index)
        left = np.arange(len(rows))  # indices of undecoded rows
        for codec, columns in self._codecs:
            left = yield from self._rows(codec, columns, rows, left, index, stamp_ns)
        while len(left):
            learnt = self._learnt
            k = index[left[0]]
            stamp_ns[k], numbers, columns = self._decode_one(payloads[int(k)])
            yield index[left[:1]], numbers[None], columns
            left = left[1:]
            if self._learnt > learnt:
                # The layout of one message usually fits all of the group.
                codec, columns = self._codecs[-1]
                left = yield from self._rows(codec, columns, rows, left, index, stamp_ns)

    def _rows(
        self,
        codec: JointStateCdr,
        columns: list[int],
        rows: NDArray[np.uint8],
        left: NDArray[np.intp],
        index: NDArray[np.intp],
        stamp_ns: NDArray[np.int64],
    ) -> Generator[_Decoded, None, NDArray[np.intp]]:
        """Decode the rows in `left` that have a layout of the codec, and return the other rows."""
        if not len(left):
            return left
        mine, stamps, numbers = codec.unpack_rows(rows if len(left) == len(rows) else rows[left])
        if mine.any():
            found = index[left[mine]]
            stamp_ns[found] = stamps
            yield found, numbers, columns
        return left[~mine]

    def _decode_one(self, payload: bytes) -> tuple[int, NDArray[np.float64], list[int]]:
        """Return the stamp [ns] of one message, its values (3, m), and the m columns for them."""
        self.singly += 1
        reader = CdrReader(payload)
        stamp_ns = reader.int32() * 1_000_000_000 + reader.uint32()
        frame_id = reader.string()
        names = reader.strings()
        self._check_names(names)
        fields = [reader.doubles() for _ in range(3)]
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
        if name not in self._columns:
            if len(self.names) == _MOST_JOINTS:
                raise ValueError(f'the messages name more than {_MOST_JOINTS} joints')
            self._columns[name] = len(self.names)
            self.names.append(name)
        return self._columns[name]

    def _remember(self, names: list[str], frame_id: str, columns: list[int]) -> None:
        known = any(
            codec.names == tuple(names) and codec.frame_id == frame_id for codec, _ in self._codecs
        )
        short = len(frame_id) + sum(map(len, names)) < _LONGEST_PREFIX
        if names and short and not known and self._learnt < _LEARNT_LAYOUTS:
            self._codecs.append((JointStateCdr(names, frame_id), columns))
            self._learnt += 1
            del self._codecs[:-_KNOWN_LAYOUTS]


def decode_joint_state(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return joint names and values of a serialized JointState, whatever its layout and byte order.

    Raises
    ------
    ValueError
        If the payload is not a JointState, or if a field is neither empty nor has one number per
        name.
    """
    return _checked(*decode_as_sent(payload))


def decode_as_sent(payload: bytes) -> tuple[tuple[str, ...], JointSample]:
    """Return joint names and values of a JointState without checking the fields' lengths.

    Raises ValueError if the payload is not a JointState.
    """
    reader = CdrReader(payload)
    stamp_ns = reader.int32() * _NANOSECONDS + reader.uint32()
    reader.string()  # frame_id
    names = tuple(reader.strings())
    return names, _sample(stamp_ns, [reader.doubles() for _ in range(3)])


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
