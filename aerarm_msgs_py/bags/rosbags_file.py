"""Messages of bags in other storages (SQLite, compressed as a whole), by the rosbags package."""

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from aerarm_msgs_py.bags.bag_error import BagError
from aerarm_msgs_py.bags.message_block import MessageBlock
from aerarm_msgs_py.codecs.payloads import Payloads

_BLOCK = 1000  # messages


class RosbagsFile:
    """Reader of a rosbag2 directory whatever its storage; same use as `McapFile`.

    Attributes
    ----------
    types
        Message type of every topic.
    damaged
        Always False: damage is an error here.
    counts
        Always None: metadata.yaml has the counts.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self.damaged = False
        self.counts: dict[str, int] | None = None

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all) in order of time.

        Raises
        ------
        BagError
            If rosbags can't read the directory.
        """
        # Imported here because it takes 0.1 s and most bags don't need it.
        from rosbags.rosbag2 import Reader, ReaderError

        try:
            with Reader(self.path) as reader:
                self.types = {c.topic: c.msgtype for c in reader.connections}
                wanted = [c for c in reader.connections if topics is None or c.topic in topics]
                waiting: dict[str, list[tuple[int, bytes]]] = {c.topic: [] for c in wanted}
                for connection, log_time, payload in reader.messages(wanted) if wanted else ():
                    messages = waiting[connection.topic]
                    messages.append((log_time, bytes(payload)))
                    if len(messages) == _BLOCK:
                        yield self._block(connection.topic, messages)
                        messages.clear()
                for topic, messages in waiting.items():
                    if messages:
                        yield self._block(topic, messages)
        except (ReaderError, OSError) as error:
            raise BagError(f'{self.path} cannot be read: {error}') from error

    def _block(self, topic: str, messages: list[tuple[int, bytes]]) -> MessageBlock:
        return MessageBlock(
            topic,
            self.types[topic],
            np.array([log_time for log_time, _ in messages], np.int64),
            np.zeros(len(messages), np.int64),
            Payloads.of(payload for _, payload in messages),
        )
