"""Serialized messages as they arrive, for loops that decode them themselves."""

from collections.abc import Callable

from rclpy.node import Node

from aerarm_msgs_py.live_topics.executor_source import ExecutorSource
from aerarm_msgs_py.live_topics.identified_take import RawMessage
from aerarm_msgs_py.live_topics.publisher_gaps import PublisherGaps
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_msgs_py.live_topics.wait_set_source import WaitSetSource

Source = WaitSetSource | ExecutorSource

_SEQUENCE = 'publication_sequence_number'
_DEFAULT_SOURCE: Callable[..., Source] = (
    WaitSetSource if WaitSetSource.available() else ExecutorSource
)


class RawReader:
    """Waits for and takes serialized messages of one or more topics.

    A controller waits for its state topic and takes the newest message; the bridge takes
    the newest command without waiting; the recorder waits for all topics and takes every
    message. The message info is rclpy's: `source_timestamp` and `received_timestamp` [ns],
    `publication_sequence_number`.

    Parameters
    ----------
    node
        Owner of the subscriptions. An executor may spin it in another thread; the reader's
        messages stay with the reader.
    topics
        What to read. All methods name a topic by its place in this list.
    source
        Way to the messages; by default a wait set, or an executor where this rclpy
        lacks what the wait set needs.
    identify
        Whether to ask who published each message: a bit slower, and lost messages of several
        publishers are then counted exactly. The info has `publisher`, 16 bytes, where this ROS
        knows.

    Raises
    ------
    ValueError
        If no topic is given.
    """

    def __init__(
        self,
        node: Node,
        *topics: Topic,
        source: Callable[..., Source] = _DEFAULT_SOURCE,
        identify: bool = False,
    ) -> None:
        if not topics:
            raise ValueError('a reader needs at least one topic')
        self.topics = topics
        self._keeps_one = [topic.qos.depth == 1 for topic in topics]
        self._source = source(node, topics, identify)
        self._gaps = [PublisherGaps() for _ in topics]
        self._counts = [0] * len(topics)

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether a topic has a message.

        Ends early, with False, on SIGINT and SIGTERM.
        """
        return self._source.wait(timeout)

    def take(self, index: int = 0) -> RawMessage | None:
        """Take the oldest waiting message and its info, or None."""
        message = self._source.take(index)
        if message is not None:
            self._counts[index] += 1
            self._gaps[index].add(message[1][_SEQUENCE], message[1].get('publisher'))
        return message

    def take_newest(self, index: int = 0) -> RawMessage | None:
        """Take all waiting messages and return the last, or None."""
        if self._keeps_one[index]:
            return self.take(index)  # the middleware has replaced the others already
        newest = None
        while (message := self.take(index)) is not None:
            newest = message
        return newest

    def count(self, index: int = 0) -> int:
        """Return how many messages were taken."""
        return self._counts[index]

    def lost(self, index: int = 0) -> int | None:
        """Return how many messages never arrived; None where the middleware doesn't number them.

        With a history of depth 1, messages that a newer one replaced count as lost too.
        """
        return self._gaps[index].lost

    def publishers(self, index: int = 0) -> int:
        """Return how many publishers are matched."""
        return int(self._source.subscriptions[index].get_publisher_count())

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._source.destroy()
