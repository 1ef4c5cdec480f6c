"""Tells the publishers of joint commands apart."""

from collections.abc import Collection, Sequence
from math import inf

# Numbers that mean "not numbered" in a message's info.
_UNNUMBERED = frozenset({0, 2**64 - 1})
_WINDOW = 100  # messages of one publisher that may be lost in a row
_MEMORY = 0.2  # [s] silence after which a publisher's next message is a new publisher's
_STREAMS_MAX = 16


class CommandPublishers:
    """Says of each message which publisher it is from, and whether that one may command.

    A message's info names no publisher, but each publisher numbers its messages 1, 2, 3...
    So a message whose number goes on from the last one of a publisher, with at most 100 lost
    between, is that publisher's: a publisher is known by its run of numbers, called `source`.
    A number that goes back by less shows two publishers too close to be told apart, which
    happens if they start at the same time: then neither of them gets a source.

    Names come from the list of a topic's endpoints, which is looked up now and then by
    somebody else. With a list of allowed names, a source is judged by the first look after
    its first message: it may command if all publishers present then are allowed. Once it may,
    it keeps the right while its numbers go on, so an intruder cannot take it away.

    Parameters
    ----------
    allowed
        Nodes that may command, as names or as names with their name space; any if empty.

    Attributes
    ----------
    names
        Publishers at the last look, full names, sorted.
    sources
        How many publishers have been told apart so far.
    """

    def __init__(self, allowed: Collection[str] = ()) -> None:
        self.names: tuple[str, ...] = ()
        self._allowed = frozenset(allowed)
        self._looks = 0
        self._streams: list[_Stream] = []
        self._unnumbered = _Stream(0, 0, 0.0, 0)
        self.sources = 0

    def look(self, names: Sequence[str]) -> None:
        """Take the full names of the publishers that are present now."""
        self.names = tuple(sorted(names))
        self._looks += 1

    def judge(self, number: int, now: float) -> tuple[int | None, bool]:
        """Tell who sent a message.

        Parameters
        ----------
        number
            The message's publication sequence number; 0 or the largest if it has none.
        now
            Time of receipt [s].

        Returns
        -------
        source : int or None
            The publisher; None if it can't be told from another one.
        allowed : bool
            Whether it may command.
        """
        if number in _UNNUMBERED:
            stream, told_apart = self._unnumbered, len(self.names) <= 1
        else:
            stream = self._stream_of(number, now)
            if number <= stream.number:
                stream.mixed = now
            stream.number = max(stream.number, number)
            stream.heard = now
            told_apart = now - stream.mixed > _MEMORY
        return stream.source if told_apart else None, self._may_command(stream)

    def _may_command(self, stream: '_Stream') -> bool:
        if not self._allowed:
            return True
        if not stream.allowed and self._looks > stream.looks:
            stream.allowed = bool(self.names) and all(map(self.is_allowed, self.names))
            stream.looks = self._looks
        return stream.allowed

    def is_allowed(self, name: str) -> bool:
        """Whether the list of allowed names holds a publisher's full name."""
        return not self._allowed or not self._allowed.isdisjoint(
            (name, name.removeprefix('/'), name.rpartition('/')[2])
        )

    @property
    def warning(self) -> str:
        """What is wrong with the publishers present, '' if nothing is."""
        others = [name for name in self.names if not self.is_allowed(name)]
        if others:
            return (
                f'{", ".join(others)} publishes joint_command without being on the list '
                'allowed_publishers: stop it, or add it to the list'
            )
        if len(self.names) > 1:
            return (
                f'joint_command has {len(self.names)} publishers ({", ".join(self.names)}), the '
                'first to command is followed: stop the others'
            )
        return ''

    def _stream_of(self, number: int, now: float) -> '_Stream':
        """Return the stream whose last number is nearest, or a new one if none is near."""
        best, least = None, _WINDOW + 1
        for stream in self._streams:
            distance = abs(number - stream.number)
            if distance < least and now - stream.heard <= _MEMORY:
                best, least = stream, distance
        return best or self._new(number - 1, now)

    def _new(self, number: int, now: float) -> '_Stream':
        self.sources += 1
        if len(self._streams) >= _STREAMS_MAX:
            self._streams.remove(min(self._streams, key=lambda stream: stream.heard))
        stream = _Stream(self.sources, number, now, self._looks)
        self._streams.append(stream)
        return stream


class _Stream:
    """A run of numbers: one publisher, or several too close to be told apart."""

    __slots__ = ('allowed', 'heard', 'looks', 'mixed', 'number', 'source')

    def __init__(self, source: int, number: int, heard: float, looks: int) -> None:
        self.source = source
        self.number = number
        self.heard = heard
        self.mixed = -inf  # when a number went back
        self.looks = looks  # at names, when it was last judged
        self.allowed = False
