"""Messages of one bag of ROS 1, a chunk at a time.

The file is read from front to end; its index is looked at for what it counts only, so that a bag
whose recorder was killed reads as well as a complete one. Format 2.0:
https://wiki.ros.org/Bags/Format/2.0.

ROS 1 packs fields without alignment, and its headers have a number (`seq`) in front. Format:
https://wiki.ros.org/msg.
"""

import bz2
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from aerarm_msgs_py.codecs.cdr import ENCAPSULATION_SIZE, LITTLE_ENDIAN, CdrPrefix, Payloads
from aerarm_msgs_py.storage.compressed_file import DecompressionError, decompress
from aerarm_msgs_py.storage.mcap_records import MOST_TOPICS, RecordFields
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, MessageBlock, ReadBudget

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


SUFFIX = '.bag'
"""Of files of ROS 1."""

_MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _BAG, _CHUNK, _COUNTS, _CONNECTION = 2, 3, 5, 6, 7  # op
_NS = 1_000_000_000
_RECORD_BYTES = 100  # counted for each record, as reading one takes time
_FILLED = struct.Struct('<II')


@dataclass(frozen=True)
class Ros1Record:
    """One record: the fields of its header, and its data."""

    header: Mapping[bytes, bytes]
    data: bytes

    @property
    def op(self) -> int:
        """What it is; 0 if it doesn't say."""
        return int.from_bytes(self.header.get(b'op', b'')[:1], 'little')

    def number(self, name: bytes) -> int:
        """Return a field as an unsigned number.

        Raises
        ------
        ValueError
            If it is missing.
        """
        if name not in self.header:
            raise ValueError(f'its field {name.decode()} is missing')
        return int.from_bytes(self.header[name][:8], 'little')

    def text(self, name: bytes) -> str:
        """Return a field as a text, empty if it is missing."""
        return self.header.get(name, b'').decode(errors='replace')


class Ros1File:
    """Reader of one .bag file; same use as `McapFile`.

    JointStates and Strings come out as ROS 2 has them. Only what is compressed by bz2 has
    checksums: other damage inside a message can't be seen.

    Parameters
    ----------
    path
        The .bag file.
    budget
        What reading may take; by default what the file's own size allows.

    Attributes
    ----------
    types
        Message type of every topic met while reading.
    damaged
        Whether reading met a missing end or damage.
    counts
        Messages of every topic by the file's index, once it was read; None without one.
    """

    def __init__(self, path: Path, budget: ReadBudget | None = None) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self.counts: dict[str, int] | None = None
        self._budget = budget
        self._report = DamageReport(path)
        self._messages = Ros1Messages()
        self._topics: dict[int, tuple[str, str]] = {}  # topic and ROS 1's type of a connection
        self._indexed: int | None = None  # chunks that the file says to have

    @property
    def damaged(self) -> bool:
        """See the class."""
        return self._report.places > 0

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all) in the order of recording.

        Raises
        ------
        BagError
            If the file can't be opened or isn't a bag of ROS 1, or would take more memory or time
            than the limits allow.
        """
        try:
            size = self.path.stat().st_size
            budget = self._budget or ReadBudget(self.path, size)
            with self.path.open('rb') as stream:
                if stream.read(len(_MAGIC)) != _MAGIC:
                    raise BagError(
                        f'{self.path} is not a bag of ROS 1, version 2.0: check the path'
                    )
                for record in self._records(stream, size, budget):
                    if record.op == _CHUNK:
                        yield from self._blocks_of(self._unpacked(record, budget), topics, budget)
                    else:
                        yield from self._blocks_of([record], topics, budget)
        except OSError as error:
            raise BagError(f'{self.path} cannot be read: {error}') from error
        if self._indexed != 0:  # of a bag without an end nothing is known
            self.counts = None
        self._report.finish()

    def _records(self, stream: BinaryIO, size: int, budget: ReadBudget) -> Iterator[Ros1Record]:
        """Yield the records of the file, up to where it is cut short."""
        while stream.tell() < size:
            place = stream.tell()
            parts = []
            for _ in range(2):
                length = int.from_bytes(stream.read(4), 'little')
                if length > min(size - stream.tell(), budget.part_bytes):
                    break
                parts.append(stream.read(length))
            if len(parts) < 2:
                self._report.tell(
                    f'ends within a record, or has one that is too large, at byte {place}: the '
                    'rest is left out',
                    size - place,
                )
                return
            budget.spend(_RECORD_BYTES)
            try:
                yield Ros1Record(_fields(parts[0]), parts[1])
            except ValueError as error:
                self._report.tell(f'is damaged at byte {place}: {error}', len(parts[1]))

    def _unpacked(self, chunk: Ros1Record, budget: ReadBudget) -> Iterator[Ros1Record]:
        """Yield the records of a chunk."""
        try:
            records = RecordFields(_decompressed(chunk, budget))
            while records.left:
                budget.spend(_RECORD_BYTES)
                header = records.take(records.number(4))
                yield Ros1Record(_fields(header), records.take(records.number(4)))
        except ValueError as error:
            self._report.tell(f'has a damaged chunk: {error}', len(chunk.data))

    def _blocks_of(
        self,
        records: Iterator[Ros1Record] | list[Ros1Record],
        topics: Collection[str] | None,
        budget: ReadBudget,
    ) -> Iterator[MessageBlock]:
        found: dict[int, list[tuple[int, bytes]]] = {}
        for record in records:
            try:
                self._learn(record)
                if record.op == _MESSAGE:
                    number = record.number(b'conn')
                    if number not in self._topics:
                        raise ValueError('nothing tells the topic of a message')
                    topic, kind = self._topics[number]
                    if topics is None or topic in topics:
                        payload = self._messages.converted(kind, record.data)
                        budget.spend(len(payload))
                        found.setdefault(number, []).append((_time(record), payload))
            except ValueError as error:
                self._report.tell(f'is damaged: {error}', len(record.data))
        for number, messages in found.items():
            yield self._block(*self._topics[number], messages)

    def _learn(self, record: Ros1Record) -> None:
        """Note what a record says of topics and of how many messages there are."""
        if record.op == _CONNECTION:
            topic = record.text(b'topic')
            kind = _fields(record.data).get(b'type', b'').decode(errors='replace')
            self._topics[record.number(b'conn')] = topic, kind
            self.types[topic] = self._messages.name(kind)
            if len(self._topics) > MOST_TOPICS:
                raise BagError(f'the bag has more than {MOST_TOPICS} topics: is it damaged?')
        elif record.op == _BAG:
            self._indexed = record.number(b'chunk_count') if record.number(b'index_pos') else None
            self.counts = {}
        elif record.op == _COUNTS and self._indexed and self.counts is not None:
            self._indexed -= 1
            for number, count in _FILLED.iter_unpack(record.data[: record.number(b'count') * 8]):
                topic, _ = self._topics.get(number, ('', ''))
                self.counts[topic] = self.counts.get(topic, 0) + count

    def _block(self, topic: str, kind: str, messages: list[tuple[int, bytes]]) -> MessageBlock:
        return MessageBlock(
            topic,
            self._messages.name(kind),
            np.array([log_time for log_time, _ in messages], np.int64),
            np.zeros(len(messages), np.int64),
            Payloads.of(payload for _, payload in messages),
        )


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields `name=value` of a header."""
    left, fields = RecordFields(header), {}
    while left.left:
        name, equals, value = left.take(left.number(4)).partition(b'=')
        if not equals:
            raise ValueError('a field of a header has no value')
        fields[name] = value
    return fields


def _time(record: Ros1Record) -> int:
    """Return when a message was received [ns]."""
    seconds, nanoseconds = divmod(record.number(b'time'), 2**32)[::-1]
    return seconds * _NS + nanoseconds


def _decompressed(chunk: Ros1Record, budget: ReadBudget) -> bytes:
    """Return the records of a chunk, within the limits.

    Raises
    ------
    ValueError
        If it is damaged, or not as large as it claims.
    """
    size, compression = chunk.number(b'size'), chunk.text(b'compression')
    if size > budget.part_bytes:
        raise DecompressionError(
            f'it claims to hold {size} bytes, more than the {budget.part_bytes} that a chunk may '
            '(limits part_bytes and ratio)'
        )
    budget.spend(size)
    if compression != 'bz2':
        return decompress(chunk.data, {'none': ''}.get(compression, compression), size)
    try:
        records = bz2.BZ2Decompressor().decompress(chunk.data, max_length=size + 1)
    except (OSError, EOFError) as error:
        raise DecompressionError(str(error)) from None
    if len(records) != size:
        raise DecompressionError(f'it holds {len(records)} bytes instead of {size}')
    return records
