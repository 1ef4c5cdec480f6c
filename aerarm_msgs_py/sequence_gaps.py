"""Gaps in the sequence numbers of messages, by publisher."""

from collections import deque
from collections.abc import Iterable

UNNUMBERED = frozenset({0, 2**32 - 1, 2**64 - 1})


_REMEMBERED_GAPS = 256


_MOST_PUBLISHERS = 64


class SequenceGaps:
    """Counts the numbers missing from a stream of publication sequence numbers.

    Each publisher numbers its own messages 1, 2, 3... and the stream doesn't say which
    publisher a message is from. A message continues the publisher with the highest number
    below its own; if there is none, it is from a publisher not heard before (or restarted).
    A number that turns up inside a gap counted earlier shows that the gap was a jump from
    one publisher to another, as one publisher's messages stay in order: it is uncounted.
    """

    def __init__(self) -> None:
        self._newest: list[int] = []  # last number of each publisher
        self._current = -1  # index of the publisher heard last
        self._gaps: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED_GAPS)
        self._lost = 0

    @property
    def lost(self) -> int | None:
        """Missing numbers so far; None if no message had a number."""
        return self._lost if self._newest else None

    def add(self, number: int) -> None:
        """Take the number of the next message."""
        if self._current >= 0 and number == self._newest[self._current] + 1:
            self._newest[self._current] = number
        elif number not in UNNUMBERED:
            self._add_out_of_step(number)

    def add_all(self, numbers: Iterable[int]) -> None:
        """Take many numbers in order."""
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
    """Counts the numbers missing from each publisher's sequence.

    With publishers that are told apart the count is exact: from the first message of each, every
    number that did not come when a later one did is a lost message. Where the middleware's info
    does not name them, `SequenceGaps` guesses who a message is from.
    """

    def __init__(self) -> None:
        self._newest: dict[bytes, int] = {}
        self._lost = 0
        self._guess = SequenceGaps()

    @property
    def lost(self) -> int | None:
        """Missing numbers so far; None if no message had a number."""
        return self._lost if self._newest else self._guess.lost

    def add(self, number: int, publisher: bytes | None) -> None:
        """Take number and publisher of the next message; None is an unknown publisher."""
        if publisher is None:
            self._guess.add(number)
        elif number not in UNNUMBERED:
            newest = self._newest.get(publisher, number - 1)
            if number > newest:  # else it came twice
                self._lost += number - newest - 1
                self._newest[publisher] = number
