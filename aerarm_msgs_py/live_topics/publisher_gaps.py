"""Lost messages of a topic, counted for each of its publishers."""

from aerarm_msgs_py.live_topics.sequence_gaps import UNNUMBERED, SequenceGaps


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
