"""How much reading a bag may take, whatever its files claim to hold."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr import Payloads


class BagError(ValueError):
    """A bag that can't be read or written; the message says what to check."""


class BagWarning(UserWarning):
    """A bag that was read, but not all of it."""


_TOLD = 5  # one by one; a file may be damaged at many thousand places


class DamageReport:
    """Warnings about one file.

    Parameters
    ----------
    path
        The file, for messages.

    Attributes
    ----------
    places
        How often something was missing or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.places = 0
        self._path = path
        self._lost = 0

    def tell(self, what: str, lost: int = 0) -> None:
        """Warn of damage, and of the bytes that are lost by it."""
        self.places += 1
        self._lost += lost
        if self.places <= _TOLD:
            warnings.warn(f'{self._path} {what}', BagWarning, stacklevel=2)

    def finish(self) -> None:
        """Warn once of the findings that were not reported one by one."""
        if self.places > _TOLD:
            warnings.warn(
                f'{self._path} is damaged at {self.places} places; {self._lost} bytes are ignored',
                BagWarning,
                stacklevel=2,
            )


_MOST = 8192  # messages of a block, so that what is made of one stays small


@dataclass(frozen=True)
class MessageBlock:
    """Serialized messages of one topic as they lie next to each other in a bag.

    Attributes
    ----------
    topic, type
        Topic and message type, for example '/joint_states', 'sensor_msgs/msg/JointState'.
    log_time
        (K,) time each message was received by the recorder [ns].
    sequence
        (K,) publication sequence numbers, 0 where the recorder didn't store them.
    payloads
        K serialized messages.
    """

    topic: str
    type: str
    log_time: NDArray[np.int64]
    sequence: NDArray[np.int64]
    payloads: Payloads

    def chosen(self, which: NDArray[np.bool_]) -> 'MessageBlock':
        """Return some of the messages, by a (K,) mask."""
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


_FREE = 2**22  # bytes that any bag may take: constant messages compress well
_MIB = 2**20
_PART_SHARE = 5  # a part takes up to nine times its bytes while its messages are looked for


@dataclass(frozen=True)
class ReadLimits:
    """Bounds on memory and time, checked before anything is decompressed.

    Attributes
    ----------
    part_bytes
        Most bytes of one part: a chunk, a message, a run of messages [bytes]. Never more than a
        fifth of what all of a bag may become.
    ratio
        Most bytes that all of a bag may become in memory, as a multiple of its size.

    Raises
    ------
    BagError
        If a bound isn't a positive number.
    """

    part_bytes: float = 64 * _MIB
    ratio: float = 100.0

    def __post_init__(self) -> None:
        for name, value in (('part_bytes', self.part_bytes), ('ratio', self.ratio)):
            if not (math.isfinite(value) and value >= 1):
                raise BagError(f'limit {name} of a bag is {value}: set it to 1 or more')


class ReadBudget:
    """Remaining limits while one bag is read.

    Parameters
    ----------
    path
        The bag, for messages.
    size
        Bytes of its files.
    limits
        See there.

    Attributes
    ----------
    part_bytes
        Most bytes of one part.
    scale
        How much more than by default the limits allow.
    """

    def __init__(self, path: Path, size: int, limits: ReadLimits | None = None) -> None:
        limits = limits or ReadLimits()
        self.scale = max(1.0, limits.ratio / ReadLimits().ratio)
        self._path, self._size, self._ratio = path, size, limits.ratio
        self._left = max(_FREE, limits.ratio * size)
        self.part_bytes = int(min(limits.part_bytes, max(_FREE, self._left / _PART_SHARE)))

    def spend(self, size: int) -> None:
        """Take bytes that the bag is about to become.

        Raises
        ------
        BagError
            If that is more than the limits allow.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f'{self._path} would grow to more than {self._ratio:g} times its {self._size} '
                'bytes when read. The file may be damaged or malicious; if you trust it, raise '
                "the limit 'ratio'"
            )
