"""Receivers of serialized messages, with a wait set or an executor, and with loss counters."""

import ctypes
from collections import deque
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerGuardCondition

from aerarm_msgs_py.sequence_gaps import PublisherGaps
from aerarm_msgs_py.topics import Topic

RawMessage = tuple[bytes, dict[str, Any]]

_TAKEN, _NOTHING = 0, 401  # RCL_RET_OK, RCL_RET_SUBSCRIPTION_TAKE_FAILED


class _Allocator(ctypes.Structure):
    """C struct `rcutils_allocator_t`: four function pointers and a pointer to a state."""

    _fields_ = [('functions', ctypes.c_void_p * 4), ('state', ctypes.c_void_p)]


class _ByteArray(ctypes.Structure):
    """C struct `rcutils_uint8_array_t`."""

    _fields_ = [
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    ]


class _MessageInfo(ctypes.Structure):
    """C struct `rmw_message_info_t` of ROS 2 Jazzy."""

    _fields_ = [
        ('source_timestamp', ctypes.c_int64),
        ('received_timestamp', ctypes.c_int64),
        ('publication_sequence_number', ctypes.c_uint64),
        ('reception_sequence_number', ctypes.c_uint64),
        ('implementation', ctypes.c_void_p),
        ('publisher', ctypes.c_ubyte * 16),
        ('from_intra_process', ctypes.c_bool),
        ('spare', ctypes.c_ubyte * 64),
    ]


class IdentifiedTake:
    """Receiver that returns each message with the identifier of the message's publisher.

    The message info of rclpy lacks the publisher, so this class calls the C library rcl. Each
    publisher numbers its own messages; without the publisher, lost messages cannot be counted
    exactly.

    Raises
    ------
    OSError, AttributeError
        If the installed ROS lacks the functions, see `available`.
    """

    def __init__(self) -> None:
        # rclpy has already loaded the library; the calls are short and keep the GIL.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        arrays = ctypes.PyDLL('librcutils.so')
        allocator = arrays.rcutils_get_default_allocator
        allocator.argtypes, allocator.restype = [], _Allocator
        self._array, self._info = _ByteArray(), _MessageInfo()
        self._memory = allocator()
        self._finish = arrays.rcutils_uint8_array_fini
        if arrays.rcutils_uint8_array_init(
            ctypes.byref(self._array), ctypes.c_size_t(4096), ctypes.byref(self._memory)
        ):
            raise OSError('rcutils cannot allocate memory for a message')

    @staticmethod
    def available() -> bool:
        """Return whether the installed rclpy is that of Jazzy, with these functions and structs."""
        try:
            return version('rclpy').startswith('7.1.')
        except PackageNotFoundError:
            return False

    def take(self, subscription: Any) -> RawMessage | None:
        """Return the oldest waiting message of a subscription (rclpy handle), with its info.

        The info has the keys of rclpy's message info, and `publisher`, an identifier of 16 bytes.
        """
        array, info = self._array, self._info
        result = self._take(
            ctypes.c_void_p(subscription.pointer), ctypes.byref(array), ctypes.byref(info), None
        )
        if result == _NOTHING:
            return None
        if result != _TAKEN:
            raise RuntimeError(
                f'a message cannot be received: rcl_take_serialized_message failed with {result}'
            )
        return ctypes.string_at(array.buffer, array.length), {
            'source_timestamp': info.source_timestamp,
            'received_timestamp': info.received_timestamp,
            'publication_sequence_number': info.publication_sequence_number,
            'reception_sequence_number': info.reception_sequence_number,
            'publisher': bytes(info.publisher),
        }

    def destroy(self) -> None:
        """Free the memory of the message buffer."""
        self._finish(ctypes.byref(self._array))


class ExecutorSource:
    """Receiver of serialized messages by subscriptions of a helper node with its own executor.

    The interface is that of `WaitSetSource`. `ExecutorSource` uses only the public API of rclpy,
    but needs about 15 us more per message. Because of the helper node, the executor runs no
    callbacks of the caller's node.

    Parameters
    ----------
    node
        Node whose namespace and context the helper node uses.
    topics
        Topics to subscribe to.
    identify
        No effect, because rclpy does not report the publisher of a message.
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
        """Wait up to `timeout` [s] for a message; return whether a topic has a message."""
        if not any(self._waiting):
            self._executor.spin_once(timeout_sec=timeout)
        return any(self._waiting)

    def take(self, index: int) -> RawMessage | None:
        """Return the oldest waiting message of a topic with its info; None if none waits."""
        waiting = self._waiting[index]
        # One spin runs one callback, of any topic.
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


_WAIT_SET_CALLS = ('clear_entities', 'add_subscription', 'add_guard_condition', 'wait', 'is_ready')


class HiddenFromExecutors(CallbackGroup):
    """Callback group that keeps executors from receiving the messages of its subscriptions."""

    def can_execute(self, entity: Any) -> bool:
        """Return False, so that no executor runs the callbacks of this group."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False, because no executor runs a callback of this group."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing, because no executor runs a callback of this group."""


class WaitSetSource:
    """Receiver of serialized messages by a node's subscriptions, which a wait set monitors.

    At each wake-up an executor builds and walks lists of all entities of a node; a wait set with
    one subscription does not. The class uses `WaitSet` and `take_message` of rclpy's implementation
    module, like `rclpy.wait_for_message`. Both are not public, so only this class uses them, and
    `available` returns whether the installed rclpy has them.

    SIGINT and SIGTERM end a wait early, through the guard condition that rclpy's signal handlers
    trigger.

    Parameters
    ----------
    node
        Owner of the subscriptions; an executor in another thread may spin it.
    topics
        Topics to subscribe to.
    identify
        Whether the message info contains the publisher, if the installed ROS supports it.
    """

    def __init__(self, node: Node, topics: Sequence[Topic], identify: bool = False) -> None:
        self._node = node
        group = HiddenFromExecutors()
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
        """Return whether the installed rclpy has the required functions."""
        wait_set = getattr(rclpy_implementation, 'WaitSet', None)
        subscription = getattr(rclpy_implementation, 'Subscription', None)
        return hasattr(subscription, 'take_message') and all(
            hasattr(wait_set, call) for call in _WAIT_SET_CALLS
        )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return whether a topic has a message."""
        wait_set = self._wait_set
        is_ready = wait_set.is_ready
        wait_set.clear_entities()
        for handle in self._handles:
            wait_set.add_subscription(handle)
        wait_set.add_guard_condition(self._signal.handle)
        wait_set.wait(int(timeout * 1e9))
        return any(is_ready('subscription', k) for k in range(len(self._handles)))

    def take(self, index: int) -> RawMessage | None:
        """Return the oldest waiting message of a topic with its info; None if none waits."""
        if self._identified is not None:
            return self._identified.take(self._handles[index])
        message: RawMessage | None
        message = self._handles[index].take_message(self._types[index], True)
        if message is not None and 'publisher_gid' in message[1]:  # rclpy after Jazzy
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
    """Do nothing; rclpy requires a callback per subscription, but no executor calls this one."""


Source = WaitSetSource | ExecutorSource

_SEQUENCE = 'publication_sequence_number'
_DEFAULT_SOURCE: Callable[..., Source] = (
    WaitSetSource if WaitSetSource.available() else ExecutorSource
)


class RawReader:
    """Receiver of the serialized messages of one or more topics.

    A controller waits for its state topic and takes the newest message. The bridge takes the newest
    command without waiting. The recorder waits for all topics and takes every message. The message
    info is that of rclpy: `source_timestamp` [ns], `received_timestamp` [ns] and
    `publication_sequence_number`.

    Parameters
    ----------
    node
        Owner of the subscriptions. An executor may spin it in another thread without taking the
        reader's messages.
    topics
        Topics to read. All methods refer to a topic by its index in this list.
    source
        Source of the messages; by default a wait set, or an executor if rclpy lacks the functions
        for the wait set.
    identify
        Whether to read the publisher of each message. This is slower, but gives the exact number of
        lost messages if a topic has several publishers. If the installed ROS supports it, the info
        then has `publisher`, an identifier of 16 bytes.

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
            raise ValueError('a RawReader needs at least one topic: pass a Topic')
        self.topics = topics
        self._keeps_one = [topic.qos.depth == 1 for topic in topics]
        self._source = source(node, topics, identify)
        self._gaps = [PublisherGaps() for _ in topics]
        self._counts = [0] * len(topics)

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return whether a topic has a message.

        SIGINT and SIGTERM end the wait early, with False.
        """
        return self._source.wait(timeout)

    def take(self, index: int = 0) -> RawMessage | None:
        """Return the oldest waiting message of a topic and its info; None if none waits."""
        message = self._source.take(index)
        if message is not None:
            self._counts[index] += 1
            self._gaps[index].add(message[1][_SEQUENCE], message[1].get('publisher'))
        return message

    def take_newest(self, index: int = 0) -> RawMessage | None:
        """Return the newest waiting message of a topic, drop older ones; None if none waits."""
        if self._keeps_one[index]:
            return self.take(index)  # the middleware has already replaced older messages
        newest = None
        while (message := self.take(index)) is not None:
            newest = message
        return newest

    def count(self, index: int = 0) -> int:
        """Return the number of messages received from a topic so far."""
        return self._counts[index]

    def lost(self, index: int = 0) -> int | None:
        """Return the number of lost messages of a topic; None without sequence numbers.

        With a queue of depth 1, a message that a newer one replaced also counts as lost.
        """
        return self._gaps[index].lost

    def publishers(self, index: int = 0) -> int:
        """Return the number of matched publishers of a topic."""
        return int(self._source.subscriptions[index].get_publisher_count())

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._source.destroy()
