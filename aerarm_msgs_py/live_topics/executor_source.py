"""Raw messages by the ordinary executor, for an rclpy without the calls of WaitSetSource."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from aerarm_msgs_py.live_topics.identified_take import RawMessage
from aerarm_msgs_py.live_topics.topic import Topic


class ExecutorSource:
    """Subscriptions of a helper node, spun by an executor of its own.

    Same use as WaitSetSource, public API only, and about 15 us slower a message. The helper
    node keeps the executor from running anything else of the caller's node.

    Parameters
    ----------
    node
        Node whose name space and context the helper shares.
    topics
        What to subscribe to.
    identify
        Of no effect: rclpy does not tell who published a message.
    """

    def __init__(self, node: Node, topics: Sequence[Topic], identify: bool = False) -> None:
        self._node = rclpy.create_node(
            f'{node.get_name()}_reader',
            namespace=node.get_namespace(),
            context=node.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self._node)
        self._waiting: list[deque[RawMessage]] = [deque(maxlen=topic.qos.depth) for topic in topics]
        self.subscriptions = [
            self._node.create_subscription(
                topic.type, topic.name, _append_to(waiting), topic.qos, raw=True
            )
            for topic, waiting in zip(topics, self._waiting, strict=True)
        ]

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for any message; return whether there is one."""
        if not any(self._waiting):
            self._executor.spin_once(timeout_sec=timeout)
        return any(self._waiting)

    def take(self, index: int) -> RawMessage | None:
        """Take the oldest waiting message of a topic, with its message info."""
        waiting = self._waiting[index]
        # One spin runs one callback, of whichever topic comes first.
        for _ in range(sum(queue.maxlen or 0 for queue in self._waiting)):
            if waiting:
                break
            self._executor.spin_once(timeout_sec=0.0)
        return waiting.popleft() if waiting else None

    def destroy(self) -> None:
        """Destroy the helper node and its executor."""
        self._executor.shutdown()
        self._node.destroy_node()


def _append_to(waiting: deque[RawMessage]) -> Callable[[bytes, dict[str, int]], None]:
    def append(payload: bytes, info: Any) -> None:
        waiting.append((payload, info))

    return append
