"""How far a recorder is behind an emulated world."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.node import Node

from aerarm_msgs_py import topics

_LAG_NS = 500_000_000
"""[ns]; a recorder's queues and the middleware's shared memory hold some seconds."""


class RecordingWatch:
    """Follows until when a recorder has the joint states, if there is one.

    Parameters
    ----------
    node
        Owner of the subscription; its executor takes the messages.
    start_ns
        Time at which the world began [ns since the epoch]. What a recorder has of before is of
        another world, such as that of a second bridge by mistake.
    """

    def __init__(self, node: Node, start_ns: int) -> None:
        self._node = node
        self._start_ns = start_ns
        self._until_ns: int | None = None
        topic = topics.RECORDED_UNTIL
        self._subscription = node.create_subscription(
            topic.type, topic.name, self._on_time, topic.qos
        )

    def is_behind(self, now_ns: int) -> bool:
        """Whether the recorder lacks more than half a second before `now_ns` [ns]."""
        until_ns = self._until_ns
        if until_ns is None or now_ns - until_ns <= _LAG_NS:
            return False
        if self._subscription.get_publisher_count() == 0:
            self._until_ns = None  # it has ended
        return self._until_ns is not None

    def give_up(self) -> None:
        """Expect nothing until the recorder tells more."""
        self._until_ns = None

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _on_time(self, message: Time) -> None:
        until_ns = message.sec * 1_000_000_000 + message.nanosec
        if until_ns >= self._start_ns:
            self._until_ns = until_ns
