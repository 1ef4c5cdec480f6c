"""Serialized messages with the id of who published them."""

import ctypes
from importlib.metadata import PackageNotFoundError, version
from typing import Any

RawMessage = tuple[bytes, dict[str, Any]]

_TAKEN, _NOTHING = 0, 401  # RCL_RET_OK, RCL_RET_SUBSCRIPTION_TAKE_FAILED
_CALLS = ('rcl_take_serialized_message',)
_ARRAY_CALLS = (
    'rcutils_get_default_allocator',
    'rcutils_uint8_array_init',
    'rcutils_uint8_array_fini',
)


class _Allocator(ctypes.Structure):
    """As rcutils has it: four functions and a state."""

    _fields_ = [('functions', ctypes.c_void_p * 4), ('state', ctypes.c_void_p)]


class _ByteArray(ctypes.Structure):
    """As rcutils has it."""

    _fields_ = [
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    ]


class _MessageInfo(ctypes.Structure):
    """As rmw of ROS 2 Jazzy has it."""

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
    """Takes messages from subscriptions through rcl, whose message info names the publisher.

    rclpy's own leaves it out, and without it the messages of several publishers, each of which
    numbers its own, cannot be told apart for sure.

    Raises
    ------
    OSError, AttributeError
        If this ROS lacks what is needed, see `available`.
    """

    def __init__(self) -> None:
        # They are loaded already, by rclpy; calls are short and keep the interpreter's lock.
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
            raise OSError('no memory for a message')

    @staticmethod
    def available() -> bool:
        """Tell whether this ROS is the one whose layouts are known here, and has the calls."""
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
        """Take the oldest waiting message of rclpy's handle of a subscription, with its info.

        The info has the keys of rclpy's, and `publisher`, 16 bytes.
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
