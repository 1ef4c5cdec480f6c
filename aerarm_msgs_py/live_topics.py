"""Receiver of serialized messages, with loss counters."""

import ctypes
from importlib.metadata import version
from typing import Any

from rclpy.callback_groups import CallbackGroup
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
    exactly. The structs are those of ROS 2 Jazzy.

    Raises
    ------
    ValueError
        If rclpy belongs to another version of ROS: wrong structs would corrupt memory.
    """

    def __init__(self) -> None:
        if not (installed := version('rclpy')).startswith('7.1.'):
            raise ValueError(
                f'rclpy {installed} is installed, but rclpy 7.1 is necessary: source the '
                'setup.bash of ROS 2 Jazzy'
            )
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


def _ignore(_: bytes) -> None:
    """Do nothing; rclpy requires a callback per subscription, but no executor calls this one."""


class RawReader:
    """Receiver of the serialized messages of one or more topics, by a wait set.

    A controller waits for its state topic and takes the newest message. The bridge takes the newest
    command without waiting. The recorder waits for all topics and takes every message. The message
    info is that of rclpy: `source_timestamp` [ns], `received_timestamp` [ns] and
    `publication_sequence_number`.

    At each wake-up an executor builds and walks lists of all entities of a node; a wait set with
    the subscriptions does not. The class uses `WaitSet` and `take_message` of rclpy's
    implementation module, like `rclpy.wait_for_message`.

    Parameters
    ----------
    node
        Owner of the subscriptions. An executor may spin it in another thread without taking the
        reader's messages.
    topics
        Topics to read. All methods refer to a topic by its index in this list.
    identify
        Whether to read the publisher of each message, which takes 8 us more. The number of lost
        messages is then exact for several publishers, and the info has `publisher`, an identifier
        of 16 bytes.
    """

    def __init__(self, node: Node, *topics: Topic, identify: bool = False) -> None:
        self.topics = topics
        self._node = node
        self._keeps_one = [topic.qos.depth == 1 for topic in topics]
        self._gaps = [PublisherGaps() for _ in topics]
        self._counts = [0] * len(topics)
        group = HiddenFromExecutors()
        self._subscriptions = [
            node.create_subscription(
                topic.type, topic.name, _ignore, topic.qos, callback_group=group, raw=True
            )
            for topic in topics
        ]
        self._handles = [subscription.handle for subscription in self._subscriptions]
        # rclpy's signal handlers trigger it, so SIGINT and SIGTERM end a wait early.
        self._signal = SignalHandlerGuardCondition(context=node.context)
        self._identified = IdentifiedTake() if identify else None
        with node.context.handle:
            self._wait_set = rclpy_implementation.WaitSet(
                len(topics), 1, 0, 0, 0, 0, node.context.handle
            )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return whether a topic has a message.

        SIGINT and SIGTERM end the wait early, with False.
        """
        wait_set = self._wait_set
        is_ready = wait_set.is_ready
        wait_set.clear_entities()
        for handle in self._handles:
            wait_set.add_subscription(handle)
        wait_set.add_guard_condition(self._signal.handle)
        wait_set.wait(int(timeout * 1e9))
        return any(is_ready('subscription', k) for k in range(len(self._handles)))

    def take(self, index: int = 0) -> RawMessage | None:
        """Return the oldest waiting message of a topic and its info; None if none waits."""
        message: RawMessage | None
        if self._identified is not None:
            message = self._identified.take(self._handles[index])
        else:
            message = self._handles[index].take_message(self.topics[index].type, True)
        if message is not None:
            info = message[1]
            self._counts[index] += 1
            self._gaps[index].add(info['publication_sequence_number'], info.get('publisher'))
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
        return int(self._subscriptions[index].get_publisher_count())

    def destroy(self) -> None:
        """Destroy the subscriptions and the wait set."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        if self._identified is not None:
            self._identified.destroy()
        self._signal.destroy()
        self._wait_set.destroy_when_not_in_use()
