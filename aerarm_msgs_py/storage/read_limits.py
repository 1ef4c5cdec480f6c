"""Limits of memory and time for reading a bag."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr import Payloads


class BagError(ValueError):
    """The bag cannot be read or written; the message states what to check."""


class BagWarning(UserWarning):
    """Part of the bag could not be read."""


_TOLD = 5  # damages reported individually, because a file may have thousands


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

    def add(self, what: str, lost: int = 0) -> None:
        """Warn of damage, and of the number of lost bytes."""
        self.places += 1
        self._lost += lost
        if self.places <= _TOLD:
            warnings.warn(f'{self._path} {what}', BagWarning, stacklevel=2)

    def finish(self) -> None:
        """Warn once of the damages that were not reported individually."""
        if self.places > _TOLD:
            warnings.warn(
                f'{self._path} is damaged at {self.places} places; {self._lost} bytes are ignored',
                BagWarning,
                stacklevel=2,
            )


_MOST = 8192  # messages of a block, which limits the size of results


@dataclass(frozen=True)
class MessageBlock:
    """Serialized consecutive messages of one topic of a bag.

    Attributes
    ----------
    topic, type
        Topic and message type, for example '/joint_states', 'sensor_msgs/msg/JointState'.
    log_time
        (K,) time of each message's reception by the recorder [ns].
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

    def chosen(self, which: NDArray[np.bool_]) -> 'MessageBlock':
        """Return the messages that a (K,) mask selects."""
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


_FREE = 2**22  # bytes permitted for any bag, because constant messages compress well
_MIB = 2**20
_PART_SHARE = 5  # reading a part temporarily takes up to nine times its bytes


@dataclass(frozen=True)
class ReadLimits:
    """Bounds on memory and time, checked before decompression.

    Attributes
    ----------
    part_bytes
        Largest size of one part: a chunk, a message, a run of messages [bytes]. At most a fifth of
        the whole bag's limit.
    ratio
        Largest size of the whole bag in memory, as a multiple of its file size.

    Raises
    ------
    BagError
        If a bound is not a positive number.
    """

    part_bytes: float = 64 * _MIB
    ratio: float = 100.0

    def __post_init__(self) -> None:
        for name, value in (('part_bytes', self.part_bytes), ('ratio', self.ratio)):
            if not (math.isfinite(value) and value >= 1):
                raise BagError(f'limit {name} of a bag is {value}: set it to 1 or more')


class ReadBudget:
    """Remaining limits while a bag is read.

    Parameters
    ----------
    path
        Path of the bag, for messages.
    size
        Size of the bag's files [bytes].

    Attributes
    ----------
    part_bytes
        Largest size of one part [bytes].
    scale
        Ratio of the limits to the default limits.
    """

    def __init__(self, path: Path, size: int, limits: ReadLimits | None = None) -> None:
        limits = limits or ReadLimits()
        self.scale = max(1.0, limits.ratio / ReadLimits().ratio)
        self._path, self._size, self._ratio = path, size, limits.ratio
        self._left = max(_FREE, limits.ratio * size)
        self.part_bytes = int(min(limits.part_bytes, max(_FREE, self._left / _PART_SHARE)))

    def spend(self, size: int) -> None:
        """Subtract bytes that the bag is about to occupy from the remaining limits.

        Raises
        ------
        BagError
            If the limits are exceeded.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f'{self._path} would grow to more than {self._ratio:g} times its {self._size} '
                'bytes when read. The file may be damaged or malicious; if you trust it, raise '
                "the limit 'ratio'"
            )
