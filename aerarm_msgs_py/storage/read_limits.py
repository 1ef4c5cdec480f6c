"""Limits of memory and time for reading a bag, and warnings about damaged bags."""

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr import Payloads


class BagError(ValueError):
    """A bag cannot be read or written; the message states what to check."""


@contextmanager
def reading(path: Path, what: str = 'file') -> Iterator[None]:
    """Convert an OSError of a `with` block to a BagError that names the file or bag `path`."""
    try:
        yield
    except OSError as error:
        raise BagError(
            f'the {what} {path} cannot be read ({error.strerror}): check the path and its '
            'permissions'
        ) from error


class BagWarning(UserWarning):
    """A part of a bag cannot be read."""


_REPORTED = 5  # damages that are reported individually, because a file may have thousands


class DamageReport:
    """Reporter of damage in one bag file.

    Parameters
    ----------
    path
        Path of the file, named in the warnings.

    Attributes
    ----------
    places
        Number of missing or damaged places.
    """

    def __init__(self, path: Path) -> None:
        self.places = 0
        self._path = path
        self._lost = 0

    def add(self, what: str, lost: int = 0) -> None:
        """Warn of damage that the sentence `what` describes; `lost` is the number of lost bytes."""
        self.places += 1
        self._lost += lost
        if self.places <= _REPORTED:
            warnings.warn(f'file {self._path}: {what}', BagWarning, stacklevel=2)

    def finish(self) -> None:
        """Warn of the total damage if not every damage was reported individually."""
        if self.places > _REPORTED:
            warnings.warn(
                f'the file {self._path} is damaged at {self.places} places; the reader ignores '
                f'{self._lost} bytes',
                BagWarning,
                stacklevel=2,
            )


_MOST = 8192  # messages per block, which limits the size of results


@dataclass(frozen=True)
class MessageBlock:
    """Consecutive serialized messages of one topic in a bag.

    Attributes
    ----------
    topic, type
        Topic and message type, for example '/joint_states', 'sensor_msgs/msg/JointState'.
    log_time
        (K,) time at which the recorder received each message [ns].
    sequence
        (K,) publication sequence numbers, 0 where the recorder did not store them.
    payloads
        The K serialized messages.
    """

    topic: str
    type: str
    log_time: NDArray[np.int64]
    sequence: NDArray[np.int64]
    payloads: Payloads

    def chosen(self, which: slice | NDArray[np.bool_]) -> 'MessageBlock':
        """Return a block with only the messages that a slice or mask (K,) selects."""
        return replace(
            self,
            log_time=self.log_time[which],
            sequence=self.sequence[which],
            payloads=self.payloads[which],
        )

    def parts(self) -> Iterator['MessageBlock']:
        """Split the block into blocks of at most `_MOST` messages."""
        if len(self.payloads) <= _MOST:
            yield self
            return
        for start in range(0, len(self.payloads), _MOST):
            yield self.chosen(slice(start, start + _MOST))


_FREE = 2**22  # bytes allowed for any bag, because constant messages compress well
_MIB = 2**20
_PART_SHARE = 5  # reading a part temporarily takes up to nine times its bytes


@dataclass(frozen=True)
class ReadLimits:
    """Limits of memory and time for reading a bag, checked before decompression.

    Attributes
    ----------
    part_bytes
        Largest size of one part (a chunk, a message or consecutive messages) [bytes]. A part may
        also not exceed a fifth of the limit for the whole bag.
    ratio
        Largest size of the whole bag in memory, as a multiple of its file size.

    Raises
    ------
    BagError
        If a limit is not a finite number of at least 1.
    """

    part_bytes: float = 64 * _MIB
    ratio: float = 100.0

    def __post_init__(self) -> None:
        for name, value in (('part_bytes', self.part_bytes), ('ratio', self.ratio)):
            if not (math.isfinite(value) and value >= 1):
                raise BagError(f'the bag limit {name} is {value}: set it to 1 or more')


class ReadBudget:
    """Memory and time that remain for reading a bag.

    Parameters
    ----------
    path
        Path of the bag, named in error messages.
    size
        Size of the bag's files [bytes].

    Attributes
    ----------
    part_bytes
        Largest size of one part [bytes].
    scale
        Ratio of the limits to the default limits, at least 1.
    """

    def __init__(self, path: Path, size: int, limits: ReadLimits | None = None) -> None:
        limits = limits or ReadLimits()
        self.scale = max(1.0, limits.ratio / ReadLimits().ratio)
        self._path, self._size, self._ratio = path, size, limits.ratio
        self._left = max(_FREE, limits.ratio * size)
        self.part_bytes = int(min(limits.part_bytes, max(_FREE, self._left / _PART_SHARE)))

    def spend(self, size: int) -> None:
        """Subtract the bytes that the next part of the bag will occupy in memory.

        Raises
        ------
        BagError
            If the limits are exceeded.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f'the bag {self._path} of {self._size} bytes needs more than {self._ratio:g} '
                'times this size in memory. The bag may be damaged or malicious; if you trust '
                'it, raise '
                "the limit 'ratio'"
            )
