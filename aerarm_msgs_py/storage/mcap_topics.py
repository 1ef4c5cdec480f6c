"""Which channel of an MCAP file is which topic."""

from collections.abc import Iterator

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.storage.bag_error import BagError
from aerarm_msgs_py.storage.damage_report import DamageReport
from aerarm_msgs_py.storage.record_fields import RecordFields

_CHANNELS = 2**16
MOST_TOPICS = 4096
"""More than any robot has."""

_NONE = -1
_CONTRADICTED = -2


class McapTopics:
    """Schema and channel records, as they are met.

    Parameters
    ----------
    channels
        Topic of each channel by the file's summary. A channel that is called otherwise in the
        file is believed neither: its messages are those of another topic, or of none.
    report
        Takes what is damaged.

    Attributes
    ----------
    names
        Topics met so far.
    types
        Message type of each of them.
    """

    def __init__(self, channels: dict[int, str], report: DamageReport) -> None:
        self.names: list[str] = []
        self.types: dict[str, str] = {}
        self._places: dict[str, int] = {}
        self._schemas: dict[int, str] = {0: ''}
        self._claimed = dict(channels)
        self._index = np.full(_CHANNELS, _NONE, np.int32)
        self._report = report

    def register(self, opcode: int, content: bytes) -> None:
        """Take a schema or channel record.

        Raises
        ------
        BagError
            If there are more topics than any robot has.
        """
        fields = RecordFields(content)
        try:
            number = fields.number(2)
            if opcode == Opcode.SCHEMA:
                self._schemas[number] = fields.text()
                return
            schema = fields.number(2)
            topic = fields.text()
        except ValueError as error:
            self._report.tell(f'is damaged: the record of a topic is left out, {error}')
            return
        if self._claimed.setdefault(number, topic) != topic:
            self._contradict(number, topic)
        elif self._index[number] != _CONTRADICTED:
            self._index[number] = self._place(topic, self._schemas.get(schema, ''))

    def groups(self, channels: NDArray[np.uint16]) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Yield the place in `names` of each topic, negative for none, and its messages.

        Parameters
        ----------
        channels
            (K,) of the messages.
        """
        if not len(channels):
            return
        places = self._index[channels]
        order = np.argsort(places, kind='stable')
        found, firsts = np.unique(places[order], return_index=True)
        yield from zip(found.tolist(), np.split(order, firsts[1:]), strict=True)

    def name(self, channel: int) -> str | None:
        """Return the topic of a channel, None if it isn't known."""
        index = int(self._index[channel])
        return None if index < 0 else self.names[index]

    def by_topic(self, counts: dict[int, int]) -> dict[str, int]:
        """Return a number of each channel as one of each topic."""
        found = dict.fromkeys(self.names, 0)
        for channel, count in counts.items():
            topic = self._claimed.get(channel, '')
            found[topic] = found.get(topic, 0) + count
        return found

    def _contradict(self, number: int, topic: str) -> None:
        if self._index[number] != _CONTRADICTED:
            self._report.tell(
                f'is damaged: channel {number} is called {self._claimed[number][:200]} and '
                f'{topic[:200]}, its messages are left out'
            )
        self._index[number] = _CONTRADICTED

    def _place(self, topic: str, kind: str) -> int:
        if topic not in self.types:
            if len(self.names) == MOST_TOPICS:
                raise BagError(f'the bag has more than {MOST_TOPICS} topics: is it damaged?')
            self._places[topic] = len(self.names)
            self.names.append(topic)
        self.types[topic] = kind
        return self._places[topic]
