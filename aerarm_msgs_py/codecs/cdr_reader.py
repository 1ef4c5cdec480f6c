"""Reading a serialized message field by field, in either byte order."""

import struct

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr_prefix import ENCAPSULATION_SIZE


class CdrReader:
    """Cursor over one plain CDR payload.

    Parameters
    ----------
    payload
        Message with its encapsulation.

    Raises
    ------
    ValueError
        From every method, if the payload is too short or not plain CDR.
    """

    def __init__(self, payload: bytes) -> None:
        if len(payload) < ENCAPSULATION_SIZE or payload[0] != 0 or payload[1] not in (0, 1):
            raise ValueError('the message is not plain CDR')
        self._order = '<' if payload[1] else '>'
        self._body = payload[ENCAPSULATION_SIZE:]
        self._position = 0

    def int32(self) -> int:
        """Read a signed 32-bit number."""
        return self._number('i')

    def uint32(self) -> int:
        """Read an unsigned 32-bit number."""
        return self._number('I')

    def octet(self) -> int:
        """Read one byte."""
        return self._take(1)[0]

    def string(self) -> str:
        """Read a string."""
        length = self.uint32()
        return self._take(length)[:-1].decode(errors='replace')

    def strings(self) -> list[str]:
        """Read a sequence of strings."""
        return [self.string() for _ in range(self._count(4))]

    def doubles(self) -> NDArray[np.float64]:
        """Read a sequence of doubles."""
        count = self._count(0)
        if count:
            self._align(8)
        return np.frombuffer(self._take(8 * count), f'{self._order}f8').astype(np.float64)

    def _number(self, code: str) -> int:
        self._align(4)
        return int(struct.unpack(self._order + code, self._take(4))[0])

    def _count(self, smallest_element: int) -> int:
        count = self.uint32()
        if count * smallest_element > len(self._body):
            raise ValueError('the message ends too early')
        return count

    def _align(self, size: int) -> None:
        self._position += -self._position % size

    def _take(self, size: int) -> bytes:
        data = self._body[self._position : self._position + size]
        if len(data) != size:
            raise ValueError('the message ends too early')
        self._position += size
        return data
