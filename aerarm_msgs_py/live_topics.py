"""Live topics as raw messages, from a wait set or an executor, with counts of lost messages."""

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
_CALLS = ('rcl_take_serialized_message',)
_ARRAY_CALLS = (
    'rcutils_get_default_allocator',
    'rcutils_uint8_array_init',
    'rcutils_uint8_array_fini',
)


class _Allocator(ctypes.Structure):
    """Allocator struct of rcutils: four functions and a state."""

    _fields_ = [('functions', ctypes.c_void_p * 4), ('state', ctypes.c_void_p)]


class _ByteArray(ctypes.Structure):
    """Byte array struct of rcutils."""

    _fields_ = [
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    ]


class _MessageInfo(ctypes.Structure):
    """Message info struct of rmw in ROS 2 Jazzy."""

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
    """Take messages from subscriptions through rcl, whose message info contains the publisher.

    rclpy's message info omits the publisher. Each publisher numbers its own messages, so without
    the publisher lost messages cannot be counted exactly.

    Raises
    ------
    OSError, AttributeError
        If this ROS lacks the functions, see `available`.
    """

    def __init__(self) -> None:
        # rclpy has already loaded the library; the calls are short and keep the interpreter's
        # lock.
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
            raise OSError('no memory left for a message')

    @staticmethod
    def available() -> bool:
        """Return whether this ROS version has the required calls and known struct layouts."""
        try:
            rcl, arrays = ctypes.PyDLL('librcl.so'), ctypes.PyDLL('librcutils.so')
            jazzy = version('rclpy').startswith('7.1.')
        except (OSError, PackageNotFoundError):
            return False
        return (
            jazzy
            and all(hasattr(rcl, call) for call in _CALLS)
            and all(hasattr(arrays, call) for call in _ARRAY_CALLS)
        )

    def take(self, subscription: Any) -> RawMessage | None:
        """Take the oldest waiting message of a subscription's rclpy handle, with its info.

        The info has the keys of rclpy's message info, and `publisher`, an identifier of 16 bytes.
        """
        array, info = self._array, self._info
        result = self._take(
            ctypes.c_void_p(subscription.pointer), ctypes.byref(array), ctypes.byref(info), None
        )
        if result == _NOTHING:
            return None
        if result != _TAKEN:
            raise RuntimeError(f'rcl_take_serialized_message failed with {result}')
        return ctypes.string_at(array.buffer, array.length), {
            'source_timestamp': info.source_timestamp,
            'received_timestamp': info.received_timestamp,
            'publication_sequence_number': info.publication_sequence_number,
            'reception_sequence_number': info.reception_sequence_number,
            'publisher': bytes(info.publisher),
        }

    def destroy(self) -> None:
        """Free the memory."""
        self._finish(ctypes.byref(self._array))


class ExecutorSource:
    """Subscriptions of a helper node, spun by its own executor.

    The interface is that of WaitSetSource. This class uses only public API, and needs about 15 us
    more per message. The helper node keeps the executor from running callbacks of the caller's
    node.

    Parameters
    ----------
    node
        Node whose namespace and context the helper shares.
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
        """Wait up to `timeout` [s] for any message; return whether there is one."""
        if not any(self._waiting):
            self._executor.spin_once(timeout_sec=timeout)
        return any(self._waiting)

    def take(self, index: int) -> RawMessage | None:
        """Take the oldest waiting message of a topic, with its message info."""
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


"""Sequence numbers of messages without a number: rosbag2 stores 0; a middleware without numbers
gives the largest uint64, of which MCAP stores 32 bits.
"""
"""Largest number of publishers; more indicate damage, and each one costs time for every message."""


_WAIT_SET_CALLS = ('clear_entities', 'add_subscription', 'add_guard_condition', 'wait', 'is_ready')


class HiddenFromExecutors(CallbackGroup):
    """Callback group that no executor runs, so that executors of the node take no messages."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: no executor runs these callbacks."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False, as for `can_execute`."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: no callback was executed."""


class WaitSetSource:
    """Subscriptions of a node that are read directly through a wait set.

    An executor builds and walks lists of all entities of a node at each wake-up; a wait set with
    one subscription does not. `rclpy.wait_for_message` uses the same two functions of the
    implementation module, `WaitSet` and `take_message`. These functions are not public, so only
    this class uses them, and `available` returns whether the installed rclpy has them.

    SIGINT and SIGTERM end a wait early, through the guard condition that rclpy's signal handlers
    trigger.

    Parameters
    ----------
    node
        Owner of the subscriptions; an executor in another thread may spin it.
    topics
        Topics to subscribe to.
    identify
        Whether the message info contains the publisher, if this ROS supports it.
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
        """Return whether the installed rclpy has the required calls."""
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
    """Stand in for a callback that is never called."""


Source = WaitSetSource | ExecutorSource

_SEQUENCE = 'publication_sequence_number'
_DEFAULT_SOURCE: Callable[..., Source] = (
    WaitSetSource if WaitSetSource.available() else ExecutorSource
)


class RawReader:
    """Wait for serialized messages of one or more topics, and take them.

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
        Whether to read the publisher of each message. Reading the publisher is slower, but counts
        lost messages of several publishers exactly. The info then has `publisher`, an identifier of
        16 bytes, if this ROS version supports it.

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

        SIGINT and SIGTERM end the wait early, with False.
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
            return self.take(index)  # the middleware has already replaced older messages
        newest = None
        while (message := self.take(index)) is not None:
            newest = message
        return newest

    def count(self, index: int = 0) -> int:
        """Return the number of messages taken."""
        return self._counts[index]

    def lost(self, index: int = 0) -> int | None:
        """Return the number of lost messages; None if the middleware does not number them.

        With a queue of depth 1, messages that a newer one replaced count as lost too.
        """
        return self._gaps[index].lost

    def publishers(self, index: int = 0) -> int:
        """Return the number of matched publishers."""
        return int(self._source.subscriptions[index].get_publisher_count())

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._source.destroy()
