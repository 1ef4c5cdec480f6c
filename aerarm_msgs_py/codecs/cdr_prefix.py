"""The constant beginning of a serialized message, compared without its padding."""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ENCAPSULATION_SIZE = 4
"""Bytes in front of the message: representation (2) and options (2)."""
LITTLE_ENDIAN = b'\x00\x01'
"""Representation identifier of plain CDR, little-endian; the options may hold anything."""


class CdrPrefix:
    """Bytes of a message that are known in advance, with alignment padding left open.

    Fast CDR doesn't clear the padding after a string, so two messages with the same
    content differ in those bytes: a plain comparison would refuse good messages now and
    then. Offsets count from the start of the payload, encapsulation included; alignment
    counts from the end of the encapsulation.

    Parameters
    ----------
    start
        Offset of the first known byte.

    Attributes
    ----------
    end
        Offset of the first byte behind the prefix.
    """

    def __init__(self, start: int) -> None:
        self.start = start
        self.end = start
        self._bytes = bytearray()
        self._mask = bytearray()
        self._value = 0
        self._mask_value = 0
        self._recent = b''

    @property
    def content(self) -> bytes:
        """The bytes, padding zero."""
        return bytes(self._bytes)

    def add_uint32(self, value: int) -> None:
        """Append an aligned 32-bit number."""
        self.align(4)
        self._append(struct.pack('<I', value))

    def add_string(self, text: str) -> None:
        """Append a string: its length with the closing zero, then its bytes."""
        encoded = text.encode() + b'\0'
        self.add_uint32(len(encoded))
        self._append(encoded)

    def add_strings(self, texts: Sequence[str]) -> None:
        """Append a sequence of strings."""
        self.add_uint32(len(texts))
        for text in texts:
            self.add_string(text)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes."""
        padding = -(self.end - ENCAPSULATION_SIZE) % size
        self._append(bytes(padding), known=False)

    def matches(self, payload: bytes) -> bool:
        """Tell whether a payload is little-endian CDR and has these bytes at this place."""
        if not payload.startswith(LITTLE_ENDIAN):
            return False
        found = payload[self.start : self.end]
        if found == self._recent:
            return True
        if len(found) < len(self._bytes):
            return False
        if int.from_bytes(found, 'little') & self._mask_value != self._value:
            return False
        # One publisher's padding seldom changes, so this spares most comparisons.
        self._recent = found
        return True

    def matching_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of the (M, size) rows match, (M,)."""
        if rows.shape[1] < self.end:
            return np.zeros(len(rows), bool)
        mask = np.frombuffer(bytes(self._mask), np.uint8)
        found = rows[:, self.start : self.end] & mask
        known = np.frombuffer(bytes(self._bytes), np.uint8)
        encapsulation = np.frombuffer(LITTLE_ENDIAN, np.uint8)
        same: NDArray[np.bool_] = (found == known).all(1) & (rows[:, :2] == encapsulation).all(1)
        return same

    def _append(self, data: bytes, *, known: bool = True) -> None:
        self._bytes += data
        self._mask += (b'\xff' if known else b'\x00') * len(data)
        self.end = self.start + len(self._bytes)
        self._value = int.from_bytes(self._bytes, 'little')
        self._mask_value = int.from_bytes(self._mask, 'little')
        self._recent = bytes(self._bytes)
