"""Limits of memory and time for reading bags of any content."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr import Payloads


class BagError(ValueError):
    """Bag that cannot be read or written; the message says what to check."""


class BagWarning(UserWarning):
    """Warning about a bag that was only partly read."""


_TOLD = 5  # findings reported one by one; a file may be damaged at thousands of places


class DamageReport:
    """Warnings about damage in one file.

    Parameters
    ----------
    path
        Path of the file, for messages.

    Attributes
    ----------
    places
        Number of missing or damaged places.
    """

    def __init__(self, path: Path) -> None:
        self.places = 0
        self._path = path
        self._lost = 0

    def tell(self, what: str, lost: int = 0) -> None:
        """Warn of damage, and of the number of lost bytes."""
        self.places += 1
        self._lost += lost
        if self.places <= _TOLD:
            warnings.warn(f'{self._path} {what}', BagWarning, stacklevel=2)

    def finish(self) -> None:
        """Warn once of all findings that were not reported individually."""
        if self.places > _TOLD:
            warnings.warn(
                f'{self._path} is damaged at {self.places} places in all, where {self._lost} '
                'bytes are left out',
                BagWarning,
                stacklevel=2,
            )


_MOST = 8192  # messages of a block, to limit the memory of derived data


@dataclass(frozen=True)
class MessageBlock:
    """Serialized messages of one topic that are adjacent in a bag.

    Attributes
    ----------
    topic, type
        Topic and message type, for example '/joint_states', 'sensor_msgs/msg/JointState'.
    log_time
        (K,) receipt time of each message at the recorder [ns].
    sequence
        (K,) publication sequence numbers, 0 if not stored.
    payloads
        The K serialized messages.
    """

    topic: str
    type: str
    log_time: NDArray[np.int64]
    sequence: NDArray[np.int64]
    payloads: Payloads

    def chosen(self, which: NDArray[np.bool_]) -> 'MessageBlock':
        """Return the messages selected by a (K,) mask."""
        return replace(
            self,
            log_time=self.log_time[which],
            sequence=self.sequence[which],
            payloads=self.payloads.chosen(which),
        )

    def parts(self) -> Iterator['MessageBlock']:
        """Yield the messages as blocks of bounded length."""
        if len(self.payloads) <= _MOST:
            yield self
            return
        for start in range(0, len(self.payloads), _MOST):
            part = slice(start, start + _MOST)
            yield replace(
                self,
                log_time=self.log_time[part],
                sequence=self.sequence[part],
                payloads=self.payloads[part],
            )


_FREE = 2**22  # bytes always allowed, because constant messages compress well
_MIB = 2**20
_PART_SHARE = 5  # while its messages are located, a part takes up to nine times its size


@dataclass(frozen=True)
class ReadLimits:
    """Bounds on memory and time, checked before anything is decompressed.

    Attributes
    ----------
    part_bytes
        Largest size of one part (a chunk, a message, a run of messages) [bytes]. At most a fifth of
        the limit for the whole bag.
    ratio
        Largest size of the whole bag in memory, as a multiple of its file size.

    Raises
    ------
    BagError
        If a limit is not a positive number.
    """

    part_bytes: float = 64 * _MIB
    ratio: float = 100.0

    def __post_init__(self) -> None:
        for name, value in (('part_bytes', self.part_bytes), ('ratio', self.ratio)):
            if not (math.isfinite(value) and value >= 1):
                raise BagError(f'the limit {name} of a bag is {value}: it must be 1 or more')


class ReadBudget:
    """Remaining limits while a bag is read.

    Parameters
    ----------
    path
        Path of the bag, for messages.
    size
        Size of its files in bytes.
    limits
        Initial limits, see `ReadLimits`.

    Attributes
    ----------
    part_bytes
        Largest size of one part in bytes.
    scale
        Factor between the given and the default limits.
    """

    def __init__(self, path: Path, size: int, limits: ReadLimits | None = None) -> None:
        limits = limits or ReadLimits()
        self.scale = max(1.0, limits.ratio / ReadLimits().ratio)
        self._path, self._size, self._ratio = path, size, limits.ratio
        self._left = max(_FREE, limits.ratio * size)
        self.part_bytes = int(min(limits.part_bytes, max(_FREE, self._left / _PART_SHARE)))

    def spend(self, size: int) -> None:
        """Deduct the bytes that the bag is about to occupy.

        Raises
        ------
        BagError
            If the remaining limits do not suffice.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f'{self._path} would become more than {self._ratio:g} times its {self._size} '
                'bytes when read: is it damaged, or made to fill the memory? If it can be '
                'trusted, raise the limit (ratio)'
            )
