"""Raw messages straight from a wait set, without an executor."""

from collections.abc import Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerGuardCondition

from aerarm_msgs_py.live_topics.identified_take import IdentifiedTake, RawMessage
from aerarm_msgs_py.live_topics.topic import Topic

_WAIT_SET_CALLS = ('clear_entities', 'add_subscription', 'add_guard_condition', 'wait', 'is_ready')


class _HiddenFromExecutors(CallbackGroup):
    """Group that no executor may run, so an executor on the same node takes no message."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class WaitSetSource:
    """Subscriptions of a node that are waited for and taken from directly.

    An executor builds and walks lists of all entities of a node at each wake-up; a wait
    set with one subscription doesn't. `rclpy.wait_for_message` is built on the same two
    calls of the implementation module, `WaitSet` and `take_message`. They aren't public,
    so they are used here only, and `available` tells whether this rclpy has them.

    SIGINT and SIGTERM end a wait early, through the guard condition that rclpy's signal
    handlers trigger.

    Parameters
    ----------
    node
        Owner of the subscriptions; it may be spun by an executor in another thread.
    topics
        What to subscribe to.
    identify
        Whether the info of messages shall name their publishers, where this ROS can.
    """

    def __init__(self, node: Node, topics: Sequence[Topic], identify: bool = False) -> None:
        self._node = node
        group = _HiddenFromExecutors()
        self.subscriptions = [
            node.create_subscription(
                topic.type, topic.name, _ignore, topic.qos, callback_group=group, raw=True
            )
            for topic in topics
        ]
        self._types = [topic.type for topic in topics]
        self._handles = [subscription.handle for subscription in self.subscriptions]
        self._signal = SignalHandlerGuardCondition(context=node.context)
        self._identified = IdentifiedTake() if identify and IdentifiedTake.available() else None
        with node.context.handle:
            self._wait_set = rclpy_implementation.WaitSet(
                len(topics), 1, 0, 0, 0, 0, node.context.handle
            )

    @staticmethod
    def available() -> bool:
        """Tell whether this rclpy has the calls used here."""
        wait_set = getattr(rclpy_implementation, 'WaitSet', None)
        subscription = getattr(rclpy_implementation, 'Subscription', None)
        return hasattr(subscription, 'take_message') and all(
            hasattr(wait_set, call) for call in _WAIT_SET_CALLS
        )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for any message; return whether there is one."""
        wait_set = self._wait_set
        is_ready = wait_set.is_ready
        wait_set.clear_entities()
        for handle in self._handles:
            wait_set.add_subscription(handle)
        wait_set.add_guard_condition(self._signal.handle)
        wait_set.wait(int(timeout * 1e9))
        return any(is_ready('subscription', k) for k in range(len(self._handles)))

    def take(self, index: int) -> RawMessage | None:
        """Take the oldest waiting message of a topic, with its message info."""
        if self._identified is not None:
            return self._identified.take(self._handles[index])
        message: RawMessage | None
        message = self._handles[index].take_message(self._types[index], True)
        if message is not None and 'publisher_gid' in message[1]:  # an rclpy after Jazzy's
            message[1]['publisher'] = bytes(message[1]['publisher_gid'])
        return message

    def destroy(self) -> None:
        """Destroy the subscriptions and the wait set."""
        for subscription in self.subscriptions:
            self._node.destroy_subscription(subscription)
        if self._identified is not None:
            self._identified.destroy()
            self._identified = None
        self._signal.destroy()
        self._wait_set.destroy_when_not_in_use()


def _ignore(_: bytes) -> None:
    """Stand in for a callback; never called."""
