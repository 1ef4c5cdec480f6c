"""How much reading a bag may take, whatever its files claim to hold."""

import math
from dataclasses import dataclass
from pathlib import Path

from aerarm_msgs_py.storage.bag_error import BagError

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
                raise BagError(f'the limit {name} of a bag is {value}: it must be 1 or more')


class ReadBudget:
    """What is left of the limits while one bag is read.

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
    """

    def __init__(self, path: Path, size: int, limits: ReadLimits | None = None) -> None:
        limits = limits or ReadLimits()
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
                f'{self._path} would become more than {self._ratio:g} times its {self._size} '
                'bytes when read: is it damaged, or made to fill the memory? If it can be '
                'trusted, raise the limit (ratio)'
            )
