"""Serialized std_msgs/Float64MultiArray at fixed offsets."""

import struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerarm_msgs_py.codecs.cdr_prefix import LITTLE_ENDIAN

# Encapsulation (4), an empty list of dimensions (4), data_offset 0 (4), count (4); the
# numbers then need 4 bytes of padding to be aligned to 8 from the end of the encapsulation.
_HEADER = struct.Struct('<2s2xIII4x')
_NO_DIMENSIONS = 0
_NO_OFFSET = 0


class Float64ArrayCdr:
    """Packs and unpacks Float64MultiArray payloads of n numbers and no layout labels.

    Parameters
    ----------
    n
        Numbers in every message, at least one.

    Raises
    ------
    ValueError
        If n is less than one.
    """

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f'an array needs at least one number, not {n}')
        self.n = n
        self._buffer = bytearray(_HEADER.size + 8 * n)
        _HEADER.pack_into(self._buffer, 0, LITTLE_ENDIAN, _NO_DIMENSIONS, _NO_OFFSET, n)
        self._data = np.frombuffer(self._buffer, '<f8', n, _HEADER.size)

    def pack(self, data: ArrayLike) -> bytes:
        """Serialize (n,) numbers; raises ValueError for another length."""
        if np.shape(data) != self._data.shape:
            raise ValueError(f'{self.n} numbers are needed, not an array of shape {np.shape(data)}')
        self._data[:] = data
        return bytes(self._buffer)

    def unpack(self, payload: bytes) -> NDArray[np.float64] | None:
        """Return the (n,) numbers as a read-only view, or None if the layout is another."""
        if len(payload) < len(self._buffer):
            return None
        expected = (LITTLE_ENDIAN, _NO_DIMENSIONS, _NO_OFFSET, self.n)
        if _HEADER.unpack_from(payload) != expected:
            return None
        return np.frombuffer(payload, '<f8', self.n, _HEADER.size)
