"""Counters of lost messages, which evaluate gaps in the publishers' sequence numbers."""

from collections import deque
from collections.abc import Hashable, Iterable

UNNUMBERED = frozenset({0, 2**32 - 1, 2**64 - 1})
"""Values of the sequence number that mean "no number".

rosbag2 stores 0. A middleware without numbers reports the largest uint64, and MCAP stores its lower
32 bits.
"""

_REMEMBERED_GAPS = 256
# More publishers indicate damage, and each one costs time for every message.
_MOST_PUBLISHERS = 64


class PublisherGaps:
    """Counter of the lost messages of several publishers.

    Every number that is missing between two received messages of a publisher is a lost message.

    Attributes
    ----------
    newest
        Last sequence number of each publisher.
    missing
        Number of missing messages so far.
    """

    def __init__(self) -> None:
        self.newest: dict[Hashable, int] = {}
        self.missing = 0

    @property
    def lost(self) -> int | None:
        """Number of missing messages so far; None if no message had a sequence number."""
        return self.missing if self.newest else None

    def add(self, number: int, publisher: Hashable) -> None:
        """Process the sequence number of the next message of a publisher."""
        if number not in UNNUMBERED:
            newest = self.newest.get(publisher, number - 1)
            if number > newest:  # otherwise a repeated message
                self.missing += number - newest - 1
                self.newest[publisher] = number


def lost_messages(numbers: Iterable[int]) -> int | None:
    """Return the number of missing messages if the publishers of the messages are unknown.

    Each publisher numbers its own messages 1, 2, 3..., but the numbers do not name the publisher. A
    message is assigned to the publisher whose last number is the highest below that of the message.
    If there is no lower number, the message belongs to a new or restarted publisher. Messages of
    one publisher stay in order. A number inside an earlier gap therefore shows that the gap was a
    change of publisher, and the gap does not count as a loss.

    Parameters
    ----------
    numbers
        Sequence numbers of the messages in order of reception.

    Returns
    -------
    int or None
        Number of missing messages; None if no message has a sequence number.
    """
    counter = PublisherGaps()
    newest = counter.newest
    gaps: deque[range] = deque(maxlen=_REMEMBERED_GAPS)
    publishers = 0
    current: Hashable = publishers
    for number in numbers:
        if newest.get(current) == number - 1:
            newest[current] = number
            continue
        if number in UNNUMBERED:
            continue
        below = [publisher for publisher, last in newest.items() if last < number]
        if below:
            current = max(below, key=newest.__getitem__)
            if number > newest[current] + 1:
                gaps.append(range(newest[current] + 1, number))
        else:
            for gap in [gap for gap in gaps if number in gap][:1]:
                counter.missing -= len(gap)
                gaps.remove(gap)
            if len(newest) == _MOST_PUBLISHERS:
                del newest[next(iter(newest))]
            current = publishers = publishers + 1
        counter.add(number, current)
    return counter.lost
