"""Where the numbers of a serialized JointState are."""

import struct

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr_prefix import ENCAPSULATION_SIZE

_COUNT = struct.Struct('<I')
_DOUBLE = 8
_DOUBLES = np.dtype('<f8')
_STAMP_SIZE = 8
_NANOSECONDS = 1_000_000_000
_EMPTY = np.empty(0)


class JointStateLayout:
    """Offsets of position, velocity and effort for one choice of which are empty.

    Each field is a count (4 bytes) and, unless empty, the numbers, aligned to 8 bytes
    from the end of the encapsulation.

    Parameters
    ----------
    start
        Offset of the first count.
    n
        Joints.
    full
        Which of position, velocity, effort hold n numbers; the others hold none.

    Attributes
    ----------
    size
        Bytes up to the end of the last field.
    """

    def __init__(self, start: int, n: int, full: tuple[bool, ...]) -> None:
        self.n = n
        self.full = full
        self._count_offsets: list[int] = []
        self._data_offsets: list[int] = []
        numbers = f'{ENCAPSULATION_SIZE}xiI'  # the stamp; then each count, the rest skipped
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
        # What stands between two full fields fills whole doubles: they are parts of one array.
        self._first = self._data_offsets[full.index(True)] if any(full) else self.size
        self._span = (self.size - self._first) // _DOUBLE
        places = [(offset - self._first) // _DOUBLE for offset in self._data_offsets]
        self._parts = [
            slice(place, place + n) if is_full else None
            for place, is_full in zip(places, full, strict=True)
        ]

    def stamp_of(self, payload: bytes) -> int | None:
        """Return the stamp [ns] of a payload, None if its counts aren't this layout's."""
        if len(payload) < self.size:
            return None
        numbers = self._numbers.unpack_from(payload)
        if numbers[2:] != self._counts:
            return None
        return int(numbers[0] * _NANOSECONDS + numbers[1])

    def matching_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of the (M, size) rows have this layout's counts, (M,)."""
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
        """Return position, velocity, effort as (n,) views of a payload that matches."""
        numbers = np.frombuffer(payload, _DOUBLES, self._span, self._first)
        position, velocity, effort = self._parts
        return (
            None if position is None else numbers[position],
            None if velocity is None else numbers[velocity],
            None if effort is None else numbers[effort],
        )

    def values_of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return (M, 3, n) numbers of rows that match, NaN for an empty field."""
        values = np.full((len(rows), 3, self.n), np.nan)
        for k, (offset, is_full) in enumerate(zip(self._data_offsets, self.full, strict=True)):
            if is_full:
                data = np.ascontiguousarray(rows[:, offset : offset + self.n * _DOUBLE])
                values[:, k] = data.view('<f8')
        return values

    def write_counts(self, buffer: bytearray) -> None:
        """Write the three counts into a payload."""
        for offset, count in zip(self._count_offsets, self._counts, strict=True):
            _COUNT.pack_into(buffer, offset, count)

    def views(self, buffer: bytearray) -> list[NDArray[np.float64]]:
        """Return writable views of position, velocity, effort; (0,) where empty."""
        return [
            np.frombuffer(buffer, '<f8', self.n, offset) if is_full else _EMPTY
            for offset, is_full in zip(self._data_offsets, self.full, strict=True)
        ]
