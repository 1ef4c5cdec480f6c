"""Messages of topics on their way into a bag."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.bags.recorded_message import RecordedMessage
from aerarm_msgs_py.codecs.cdr_prefix import ENCAPSULATION_SIZE
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_msgs_py.live_topics.sequence_gaps import UNNUMBERED
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_msgs_py.topics import JOINT_STATES
from aerarm_ros.ros.recording.recorded_topics import as_recorded
from aerarm_ros.ros.recording.repeated_states import RepeatedStates

_STAMP_END = ENCAPSULATION_SIZE + 8
_DISORDER = 1_000_000_000  # [ns] at most


class BagFeed:
    """Subscriptions and a bag: moves messages from one to the other, and counts them.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    topics
        To be recorded, as the bag describes them.
    subscribed
        The same with the history that a subscription shall have.
    directory, compression
        Of the bag.

    Attributes
    ----------
    names
        Full names of the topics.

    Raises
    ------
    ValueError
        If the bag can't be made.
    """

    def __init__(
        self,
        node: Node,
        topics: Sequence[Topic],
        subscribed: Sequence[Topic],
        directory: str,
        compression: str,
    ) -> None:
        self.names = [node.resolve_topic_name(topic.name) for topic in topics]
        recorded = map(as_recorded, topics, self.names)
        self._writer = BagWriter(directory, list(recorded), compression)
        self._reader = RawReader(node, *subscribed, identify=True)
        self._received = [0] * len(topics)  # [ns] of the last message of each topic
        self._states = RepeatedStates()
        self._states_index = next(
            (index for index, topic in enumerate(topics) if topic.name == JOINT_STATES.name), -1
        )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether a message came."""
        return self._reader.wait(timeout)

    def take(self, limit: int) -> None:
        """Move waiting messages into the bag, up to a limit of each topic; raises BagError.

        Without a limit a recorder that is too slow would never do anything else.
        """
        take, write = self._reader.take, self._writer.write
        for index in range(len(self.names)):
            for _ in range(limit):
                message = take(index)
                if message is None:
                    break
                payload, info = message
                repeats = 0
                if index == self._states_index:
                    if self._states.has(payload):
                        continue
                    repeats = self._states.count
                received = self._in_order(index, info['received_timestamp'] or time.time_ns())
                write(
                    RecordedMessage(
                        index,
                        payload,
                        received,
                        info['source_timestamp'] or received,
                        # What was told again leaves no gap.
                        self._number(index, info) - repeats,
                    )
                )

    def _in_order(self, index: int, received: int) -> int:
        """Return the time of reception [ns] of a message, not before that of the last of its topic.

        Bags are read by this time, and numbered as taken: of several publishers a message may be
        taken after one that came later. A clock that was set back is another matter.
        """
        if self._received[index] - received < _DISORDER:
            received = max(received, self._received[index])
        self._received[index] = received
        return received

    def _number(self, index: int, info: dict[str, Any]) -> int:
        """Return a message's number in the bag, whose gaps are lost messages.

        Each publisher numbers its own. A bag knows nothing of publishers: where they are told
        apart, their messages are numbered as those of one.
        """
        number: int = info['publication_sequence_number']
        if number in UNNUMBERED or 'publisher' not in info:
            return number
        return self._reader.count(index) + (self._reader.lost(index) or 0)

    def until(self) -> bytes:
        """Return the stamp of the newest joint state, a serialized Time; b'' before the first."""
        # A Time is serialized as the stamp with which a JointState begins.
        return self._states.last[:_STAMP_END]

    def publishers(self) -> list[int]:
        """Return how many publishers each topic has."""
        return [self._reader.publishers(k) for k in range(len(self.names))]

    def heard(self) -> dict[str, tuple[int, int | None]]:
        """Return messages, and lost ones (None: not known), of each topic that is heard."""
        read, counts = self._reader, self._writer.counts
        heard = {name: (counts[k], read.lost(k)) for k, name in enumerate(self.names)}
        return {name: numbers for name, numbers in heard.items() if numbers[0]}

    def total_lost(self) -> object:
        """Return how many messages are lost, 'unknown' if any topic's can't be counted."""
        lost = [lost for _, lost in self.heard().values()]
        return 'unknown' if None in lost else sum(filter(None, lost))

    def written(self) -> tuple[int, int]:
        """Return how many messages are in the bag, and how many bytes."""
        return sum(self._writer.counts), os.fstat(self._writer.fileno()).st_size

    def complete(self) -> None:
        """Store what is on its way and complete the bag; raises BagError. Twice is no harm."""
        self._writer.close()

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()
