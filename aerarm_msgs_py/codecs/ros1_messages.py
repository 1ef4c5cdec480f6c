"""Messages as ROS 1 serializes them, turned into those of ROS 2.

ROS 1 packs fields without alignment, and its headers have a number (`seq`) in front. Format:
https://wiki.ros.org/msg.
"""

import struct
from collections.abc import Callable

from aerarm_msgs_py.codecs.cdr_prefix import ENCAPSULATION_SIZE, LITTLE_ENDIAN, CdrPrefix

_LENGTH = struct.Struct('<I')
_STAMP = slice(4, 12)  # behind header.seq
_PREFIX = 12  # where frame and joint names begin
_FIELDS = 3  # position, velocity, effort
_DOUBLE = 8  # bytes
_MOST_NAMES = 1024  # of one message


class Ros1Messages:
    """Turns serialized messages of the types that are known into CDR.

    Joint names are the same in message after message, so their bytes are made once.
    """

    def __init__(self) -> None:
        self._known = b''  # frame and names as the last message had them
        self._prefix = b''  # the same in CDR, stamp left out
        self._converters: dict[str, Callable[[bytes], bytes]] = {
            'sensor_msgs/JointState': self._joint_state,
            'std_msgs/String': _string,
        }

    def name(self, kind: str) -> str:
        """Return the type's name in ROS 2; that of ROS 1 where messages are left as they are."""
        return kind.replace('/', '/msg/', 1) if kind in self._converters else kind

    def converted(self, kind: str, payload: bytes) -> bytes:
        """Return a message of a type, as ROS 1 names it, in CDR; others unchanged.

        Raises
        ------
        ValueError
            If it is shorter or longer than it says itself.
        """
        converter = self._converters.get(kind)
        return payload if converter is None else converter(payload)

    def _joint_state(self, payload: bytes) -> bytes:
        end = _PREFIX + len(self._known)
        if not self._known or payload[_PREFIX:end] != self._known:
            end = self._learn(payload)
        parts = [LITTLE_ENDIAN, b'\0\0', payload[_STAMP], self._prefix]
        size = ENCAPSULATION_SIZE + 8 + len(self._prefix)  # the prefix ends at a multiple of 4
        for _ in range(_FIELDS):
            count = _number(payload, end)
            numbers = payload[end + 4 : end + 4 + _DOUBLE * count]
            if len(numbers) != _DOUBLE * count:
                raise ValueError('it ends within its numbers')
            end += 4 + len(numbers)
            size += 4
            padding = -(size - ENCAPSULATION_SIZE) % _DOUBLE if count else 0
            parts += [_LENGTH.pack(count), bytes(padding), numbers]
            size += padding + len(numbers)
        if end != len(payload):
            raise ValueError(f'it has {len(payload) - end} bytes more than a JointState')
        return b''.join(parts)

    def _learn(self, payload: bytes) -> int:
        """Read frame and names of a message; return where they end."""
        frame, end = _text(payload, _PREFIX)
        count = _number(payload, end)
        if count > _MOST_NAMES:
            raise ValueError(f'it names {count} joints')
        end += 4
        names = []
        for _ in range(count):
            name, end = _text(payload, end)
            names.append(name)
        prefix = CdrPrefix(ENCAPSULATION_SIZE + 8)
        prefix.add_string(frame)
        prefix.add_strings(names)
        prefix.align(4)
        self._known, self._prefix = payload[_PREFIX:end], prefix.content
        return end


def _string(payload: bytes) -> bytes:
    text, end = _text(payload, 0)
    if end != len(payload):
        raise ValueError(f'it has {len(payload) - end} bytes more than a String')
    content = CdrPrefix(ENCAPSULATION_SIZE)
    content.add_string(text)
    return LITTLE_ENDIAN + b'\0\0' + content.content


def _number(payload: bytes, start: int) -> int:
    if start + _LENGTH.size > len(payload):
        raise ValueError('it ends too early')
    return int(_LENGTH.unpack_from(payload, start)[0])


def _text(payload: bytes, start: int) -> tuple[str, int]:
    end = start + 4 + _number(payload, start)
    if end > len(payload):
        raise ValueError('it ends within a text')
    return payload[start + 4 : end].decode(errors='replace'), end
