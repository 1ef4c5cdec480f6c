"""Many serialized JointStates to arrays, vectorised where their layouts agree."""

from collections import Counter
from collections.abc import Generator, Iterator

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr_reader import CdrReader
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.codecs.payloads import Payloads

# Which messages, (k, 3, m) numbers, and the columns of the m joints.
_Decoded = tuple[NDArray[np.intp], NDArray[np.float64], list[int]]

_KNOWN_LAYOUTS = 8
_LEARNT_LAYOUTS = 64  # in all: learning one takes a while
_MOST_JOINTS = 256  # of one topic: more than any robot's, and memory has an end
_LONGEST_NAME = 255  # characters
_LONGEST_PREFIX = 2**14  # bytes of names that are worth learning


class JointStateDecoder:
    """Decodes blocks of payloads, and remembers joint names from block to block.

    Messages of equal names, frame and size are decoded together by `JointStateCdr`; any
    other one by itself. Columns are joints by name: a joint met for the first time gets a
    new column.

    Attributes
    ----------
    names
        Joint names met so far, in the order of the columns.
    irregular
        Fields left out because their length was neither 0 nor that of the names.
    singly
        Messages that were decoded by themselves, which takes a hundred times as long.
    """

    def __init__(self) -> None:
        self.names: list[str] = []
        self.irregular = 0
        self.singly = 0
        self._columns: dict[str, int] = {}
        self._codecs: list[tuple[JointStateCdr, list[int]]] = []
        self._learnt = 0

    def decode(self, payloads: Payloads) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Decode K messages.

        Returns
        -------
        stamp_ns : (K,) `header.stamp` [ns]
        values : (K, 3, n) position, velocity, effort [rad, rad/s, Nm] of all joints met so
            far; NaN where missing

        Raises
        ------
        ValueError
            If a payload is no JointState, names a joint twice, or there are more joints than a
            robot has.
        """
        stamp_ns = np.zeros(len(payloads), np.int64)
        decoded: list[_Decoded] = []
        for index in _groups_of_size(payloads.sizes):
            decoded += self._decode_group(payloads, index, stamp_ns)
        values = np.full((len(payloads), 3, len(self.names)), np.nan)
        for index, numbers, columns in decoded:
            values[index[:, None], :, columns] = numbers.transpose(0, 2, 1)
        return stamp_ns, values

    def _decode_group(
        self, payloads: Payloads, index: NDArray[np.intp], stamp_ns: NDArray[np.int64]
    ) -> Iterator[_Decoded]:
        """Yield messages of equal size, decoded."""
        rows = payloads.rows(index)
        left = np.arange(len(rows))  # of them
        for codec, columns in self._codecs:
            left = yield from self._rows(codec, columns, rows, left, index, stamp_ns)
        while len(left):
            learnt = self._learnt
            k = index[left[0]]
            stamp_ns[k], numbers, columns = self._decode_one(payloads[int(k)])
            yield index[left[:1]], numbers[None], columns
            left = left[1:]
            if self._learnt > learnt:
                # A message shows the layout that the others usually have.
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
        """Yield those of the rows left that are of a codec; return the others."""
        if not len(left):
            return left
        mine, stamps, numbers = codec.unpack_rows(rows if len(left) == len(rows) else rows[left])
        if mine.any():
            found = index[left[mine]]
            stamp_ns[found] = stamps
            yield found, numbers, columns
        return left[~mine]

    def _decode_one(self, payload: bytes) -> tuple[int, NDArray[np.float64], list[int]]:
        """Return stamp [ns], (3, m) numbers and the m columns they belong to."""
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
            raise ValueError(f'a joint has a name of more than {_LONGEST_NAME} characters')
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise ValueError(
                f'a message names joint {", ".join(repeated)} more than once: check the joint '
                'names of the node that publishes it'
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


def _groups_of_size(sizes: NDArray[np.int64]) -> Iterator[NDArray[np.intp]]:
    """Yield which messages are of each size, in order."""
    if not len(sizes):
        return
    if (sizes == sizes[0]).all():
        yield np.arange(len(sizes))
        return
    order = np.argsort(sizes, kind='stable')
    firsts = np.unique(sizes[order], return_index=True)[1]
    yield from sorted(np.split(order, firsts[1:]), key=lambda index: int(index[0]))
