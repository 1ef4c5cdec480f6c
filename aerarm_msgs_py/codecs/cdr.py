"""Readers and writers for CDR, the serialization format of ROS messages."""

import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

ENCAPSULATION_SIZE = 4
"""Size of the header before the message [bytes]: representation (2) and options (2)."""
LITTLE_ENDIAN = b'\x00\x01'
"""First two bytes of a little-endian CDR message."""


class CdrPrefix:
    """Constant texts of a message type, to compare messages without alignment padding.

    Fast CDR does not clear the padding after a string. Two messages with equal content can
    therefore differ in the padding, and a comparison of all bytes would sometimes reject a valid
    message. Offsets are relative to the start of the payload, alignment to the end of the
    encapsulation.

    Parameters
    ----------
    start
        Offset of the first constant byte.
    text, texts
        A string and a sequence of strings, followed by padding to a multiple of 4 bytes.

    Attributes
    ----------
    end
        Offset of the first byte after the prefix.
    content, mask
        Bytes of the constant fields, with zeros as padding, and their bits, without the padding.
    """

    def __init__(self, start: int, text: str, texts: Sequence[str]) -> None:
        content, mask = b'', b''
        strings = [item.encode() + b'\0' for item in (text, *texts)]
        parts = [struct.pack('<I', len(item)) + item for item in strings]
        for part in (parts[0], struct.pack('<I', len(texts)), *parts[1:], b''):
            padding = bytes(-(start + len(content) - ENCAPSULATION_SIZE) % 4)
            content += padding + part
            mask += padding + b'\xff' * len(part)
        self.start, self.end = start, start + len(content)
        self.content = self._recent = content
        self._value, self._mask = (int.from_bytes(part, 'little') for part in (content, mask))
        self.mask = mask

    def matches(self, payload: bytes) -> bool:
        """Return whether a payload is little-endian CDR and contains these fields at `start`."""
        if not payload.startswith(LITTLE_ENDIAN):
            return False
        found = payload[self.start : self.end]
        if found == self._recent:
            return True
        if len(found) < len(self.content):
            return False
        if int.from_bytes(found, 'little') & self._mask != self._value:
            return False
        # The padding of a publisher seldom changes, so this avoids most masked comparisons.
        self._recent = found
        return True


class CdrReader:
    """Reader of the fields of one CDR message, in order.

    Parameters
    ----------
    payload
        Message including its encapsulation.

    Raises
    ------
    ValueError
        From every method, if the payload is too short or not plain CDR.
    """

    def __init__(self, payload: bytes) -> None:
        if len(payload) < ENCAPSULATION_SIZE or payload[0] != 0 or payload[1] not in (0, 1):
            raise ValueError('the message does not begin with the header of plain CDR')
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
        """Read a sequence of doubles, which begins with its length."""
        count = self._count(0)
        if count:
            self._align(8)
        return np.frombuffer(self._take(8 * count), f'{self._order}f8').astype(np.float64)

    def fixed_doubles(self, count: int) -> NDArray[np.float64]:
        """Read an array of `count` doubles, which has no length field."""
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


class Payloads(Sequence[bytes]):
    """Sequence of K serialized messages in one buffer; only access to a message copies it.

    Parameters
    ----------
    buffer
        Buffer with the messages, and possibly other bytes between them.
    starts, sizes
        (K,) offset and length of each message in the buffer [bytes].
    """

    def __init__(self, buffer: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64]) -> None:
        self._buffer = buffer
        self._starts = starts
        self.sizes = sizes

    @classmethod
    def of(cls, messages: Iterable[bytes]) -> 'Payloads':
        """Return the given messages, concatenated in one buffer."""
        messages = list(messages)
        sizes = np.fromiter(map(len, messages), np.int64, len(messages))
        return cls(b''.join(messages), np.cumsum(sizes) - sizes, sizes)

    def __len__(self) -> int:
        return len(self.sizes)

    @overload
    def __getitem__(self, index: int) -> bytes: ...

    @overload
    def __getitem__(self, index: slice | NDArray[np.bool_]) -> 'Payloads': ...

    def __getitem__(self, index: int | slice | NDArray[np.bool_]) -> 'bytes | Payloads':
        """Return one message, or the messages of a slice or mask (K,)."""
        if isinstance(index, int):
            start = int(self._starts[index])
            return self._buffer[start : start + int(self.sizes[index])]
        return Payloads(self._buffer, self._starts[index], self.sizes[index])

    def __iter__(self) -> Iterator[bytes]:
        buffer = self._buffer
        for start, size in zip(self._starts.tolist(), self.sizes.tolist(), strict=True):
            yield buffer[start : start + size]

    def rows(self, index: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Return the messages as the rows of an array; all must have the same size.

        Parameters
        ----------
        index
            (k,) indices of the messages.

        Returns
        -------
        (k, size) bytes
        """
        size = int(self.sizes[index[0]]) if len(index) else 0
        if not size:
            return np.empty((len(index), 0), np.uint8)
        taken = elements_at(self._buffer, np.dtype((np.void, size)), self._starts[index])
        return taken.view(np.uint8).reshape(len(index), size)

    def groups_of_size(self) -> Iterator[NDArray[np.intp]]:
        """Yield the indices of the messages of equal size, one array per size."""
        sizes = self.sizes
        if not len(sizes):
            return
        order = np.argsort(sizes, kind='stable')
        firsts = np.unique(sizes[order], return_index=True)[1]
        yield from sorted(np.split(order, firsts[1:]), key=lambda index: int(index[0]))


def elements_at(buffer: bytes, kind: np.dtype[Any], starts: NDArray[np.int64]) -> NDArray[Any]:
    """Return K elements of type `kind` from the byte offsets `starts` in a buffer.

    Raises
    ------
    IndexError
        If an element would extend beyond the end of the buffer.
    """
    places = len(buffer) - kind.itemsize + 1
    if places < 1:
        if len(starts):
            raise IndexError('the buffer is shorter than one element')
        return np.empty(0, kind)
    # Overlapping elements, one per byte offset, of which only the selected ones are copied.
    return np.ndarray((places,), kind, buffer, strides=(1,))[starts]


def diagnostic_values(payload: bytes) -> dict[str, dict[str, str]]:
    """Return the key-value pairs of each status in a DiagnosticArray, by status name.

    Raises
    ------
    ValueError
        If the payload is not a DiagnosticArray.
    """
    reader = CdrReader(payload)
    reader.int32(), reader.uint32(), reader.string()  # header
    found: dict[str, dict[str, str]] = {}
    for _ in range(reader.uint32()):
        reader.octet()  # level
        name = reader.string()
        reader.string(), reader.string()  # message, hardware
        found[name] = {reader.string(): reader.string() for _ in range(reader.uint32())}
    return found


# Encapsulation (4), an empty list of dimensions (4), data_offset 0 (4), count (4). The numbers
# then need 4 bytes of padding to be aligned to 8 from the end of the encapsulation.
_HEADER = struct.Struct('<2s2xIII4x')
_NO_DIMENSIONS = 0
_NO_OFFSET = 0


class Float64ArrayCdr:
    """Codec of Float64MultiArray messages with n numbers and without layout labels.

    Parameters
    ----------
    n
        Number of values in every message, at least one.

    Raises
    ------
    ValueError
        If n is less than one.
    """

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f'n is {n}: an array must have at least one number')
        self.n = n
        self._buffer = bytearray(_HEADER.size + 8 * n)
        _HEADER.pack_into(self._buffer, 0, LITTLE_ENDIAN, _NO_DIMENSIONS, _NO_OFFSET, n)
        self._data = np.frombuffer(self._buffer, '<f8', n, _HEADER.size)

    def pack(self, data: ArrayLike) -> bytes:
        """Serialize n numbers; raises ValueError if `data` has another length."""
        if np.shape(data) != self._data.shape:
            raise ValueError(
                f'data has the shape {np.shape(data)}: an array of {self.n} numbers is needed'
            )
        self._data[:] = data
        return bytes(self._buffer)

    def unpack(self, payload: bytes) -> NDArray[np.float64] | None:
        """Return the n numbers as a read-only view; None if the message has another layout."""
        if len(payload) < len(self._buffer):
            return None
        expected = (LITTLE_ENDIAN, _NO_DIMENSIONS, _NO_OFFSET, self.n)
        if _HEADER.unpack_from(payload) != expected:
            return None
        return np.frombuffer(payload, '<f8', self.n, _HEADER.size)
