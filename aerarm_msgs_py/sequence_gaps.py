"""Counters of lost messages, which evaluate gaps in the publishers' sequence numbers."""

from collections import deque
from collections.abc import Iterable

UNNUMBERED = frozenset({0, 2**32 - 1, 2**64 - 1})
"""Values of the sequence number that mean "no number".

rosbag2 stores 0. A middleware without numbers reports the largest uint64, and MCAP stores its lower
32 bits.
"""

_REMEMBERED_GAPS = 256
# More publishers indicate damage, and each one costs time for every message.
_MOST_PUBLISHERS = 64


class SequenceGaps:
    """Estimator of the number of lost messages if the publishers of messages are unknown.

    Each publisher numbers its own messages 1, 2, 3..., but the numbers do not name the publisher. A
    message is assigned to the publisher whose last number is the highest below that of the message.
    If there is no lower number, the message belongs to a new or restarted publisher. Messages of
    one publisher stay in order. A number inside an earlier gap therefore shows that the gap was a
    change of publisher, and the gap no longer counts as a loss.
    """

    def __init__(self) -> None:
        self._newest: list[int] = []  # last number of each publisher
        self._current = -1  # index of the last message's publisher
        self._gaps: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED_GAPS)
        self._lost = 0

    @property
    def lost(self) -> int | None:
        """Number of missing messages so far; None if no message had a sequence number."""
        return self._lost if self._newest else None

    def add(self, number: int) -> None:
        """Process the sequence number of the next message."""
        if self._current >= 0 and number == self._newest[self._current] + 1:
            self._newest[self._current] = number
        elif number not in UNNUMBERED:
            self._add_out_of_step(number)

    def add_all(self, numbers: Iterable[int]) -> None:
        """Process the sequence numbers of several messages in order."""
        for number in numbers:
            self.add(number)

    def _add_out_of_step(self, number: int) -> None:
        below = [k for k, newest in enumerate(self._newest) if newest < number]
        if not below:
            self._forget_gap_around(number)
            if len(self._newest) == _MOST_PUBLISHERS:
                self._newest.pop(0)
            self._current = len(self._newest)
            self._newest.append(number)
            return
        self._current = max(below, key=self._newest.__getitem__)
        previous = self._newest[self._current]
        if number > previous + 1:
            self._gaps.append((previous + 1, number))
            self._lost += number - previous - 1
        self._newest[self._current] = number

    def _forget_gap_around(self, number: int) -> None:
        for gap in self._gaps:
            start, stop = gap
            if start <= number < stop:
                self._lost -= stop - start
                self._gaps.remove(gap)
                return


class PublisherGaps:
    """Counter of the lost messages of several publishers.

    Every number that is missing between two received messages of a publisher is a lost message.
    """

    def __init__(self) -> None:
        self._newest: dict[bytes, int] = {}
        self._lost = 0

    @property
    def lost(self) -> int | None:
        """Number of missing messages so far; None if no message had a sequence number."""
        return self._lost if self._newest else None

    def add(self, number: int, publisher: bytes) -> None:
        """Process the sequence number of the next message of a publisher."""
        if number not in UNNUMBERED:
            newest = self._newest.get(publisher, number - 1)
            if number > newest:  # otherwise a repeated message
                self._lost += number - newest - 1
                self._newest[publisher] = number
