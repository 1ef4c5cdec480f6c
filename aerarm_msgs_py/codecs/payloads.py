"""Serialized messages that lie somewhere in one buffer."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray


class Payloads(Sequence[bytes]):
    """K serialized messages inside a buffer, cut out only when asked for.

    Parameters
    ----------
    buffer
        Holds the messages, and possibly other bytes between them.
    starts, sizes
        (K,) offset and length of each message [bytes]; all inside the buffer.
    """

    def __init__(self, buffer: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64]) -> None:
        self._buffer = buffer
        self._starts = starts
        self.sizes = sizes

    @classmethod
    def of(cls, messages: Iterable[bytes]) -> 'Payloads':
        """Put messages next to each other into a buffer."""
        messages = list(messages)
        sizes = np.fromiter(map(len, messages), np.int64, len(messages))
        return cls(b''.join(messages), np.cumsum(sizes) - sizes, sizes)

    def __len__(self) -> int:
        return len(self.sizes)

    @overload
    def __getitem__(self, index: int) -> bytes: ...

    @overload
    def __getitem__(self, index: slice) -> 'Payloads': ...

    def __getitem__(self, index: int | slice) -> 'bytes | Payloads':
        """Return one message, or some of them."""
        if isinstance(index, slice):
            return Payloads(self._buffer, self._starts[index], self.sizes[index])
        start = int(self._starts[index])
        return self._buffer[start : start + int(self.sizes[index])]

    def __iter__(self) -> Iterator[bytes]:
        buffer = self._buffer
        for start, size in zip(self._starts.tolist(), self.sizes.tolist(), strict=True):
            yield buffer[start : start + size]

    def chosen(self, which: NDArray[np.bool_]) -> 'Payloads':
        """Return some of the messages, by a (K,) mask."""
        return Payloads(self._buffer, self._starts[which], self.sizes[which])

    def rows(self, index: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Return messages of equal size as the rows of an array.

        Parameters
        ----------
        index
            (k,) which ones.

        Returns
        -------
        (k, size) bytes
        """
        size = int(self.sizes[index[0]]) if len(index) else 0
        if not size:
            return np.empty((len(index), 0), np.uint8)
        taken = elements_at(self._buffer, np.dtype((np.void, size)), self._starts[index])
        return taken.view(np.uint8).reshape(len(index), size)


def elements_at(buffer: bytes, kind: np.dtype[Any], starts: NDArray[np.int64]) -> NDArray[Any]:
    """Return the (K,) elements of a type that begin at any bytes of a buffer.

    Raises
    ------
    IndexError
        If one would reach beyond the end.
    """
    places = len(buffer) - kind.itemsize + 1
    if places < 1:
        if len(starts):
            raise IndexError('the buffer is shorter than one element')
        return np.empty(0, kind)
    # Overlapping elements, one beginning at every byte, of which only some are copied.
    return np.ndarray((places,), kind, buffer, strides=(1,))[starts]
