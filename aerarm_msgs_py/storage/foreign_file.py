"""Reader of ROS 1 and SQLite bag files, which uses the library rosbags in a separate process.

rosbags does not check the sizes that a file declares. The separate process therefore has limits of
memory and processor time, in proportion to the size of the file. If the process reaches a limit,
reading ends with one error. The process writes blocks of messages to its standard output, from
which `ForeignFile` reads them.
"""

import contextlib
import json
import os
import resource
import signal
import struct
import subprocess
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage.compressed_file import BagFile
from aerarm_msgs_py.storage.mcap_records import MOST_TOPICS
from aerarm_msgs_py.storage.read_limits import BagError, MessageBlock, ReadBudget, reading

_BEGINNINGS = {
    '.bag': (b'#ROSBAG V2.0\n', 'a ROS 1 bag (format version 2.0)'),
    '.db3': (b'SQLite format 3\0', 'an SQLite file'),
}
_REPAIRS = {'.bag': 'rosbag reindex', '.db3': 'sqlite3 FILE .recover'}
_NUMBER = struct.Struct('<q')
_HEAD = struct.Struct('<iIQ')  # index of the topic, messages, bytes
_TOPICS, _END = -1, -2  # instead of an index: a JSON text follows
_BLOCK = 1000  # messages
_BLOCK_BYTES = 2**20
_LONGEST_NAME = 4096  # characters
_LONGEST_ERROR = 200  # characters

# Limits of the process in addition to its start. Per MB a valid file needs 0.1 s and 1 MB. With
# empty messages it needs ten times this memory, because rosbags keeps the index of a ROS 1 file.
_SECONDS, _SECONDS_PER_BYTE = 2.0, 2e-6
_MEMORY, _MEMORY_PER_BYTE = 100 * 2**20, 10.0
_OF_LIMITS = ('NoMemError', 'IOError', 'FullError')  # SQLite's errors of memory and temporary file
_MOST_SECONDS, _MOST_MEMORY = 2**31, 2**62


class ForeignFile(BagFile):
    """Reader of one .bag or .db3 file.

    The messages are in order of reception. ROS 1 messages of standard types are converted to ROS 2.
    Only data compressed by bz2 has checksums; other damage inside a message is not detected.

    `types` is empty and `counts` None before the file is opened. `counts` is from the index or the
    tables of the file.
    """

    def __init__(self, path: Path, budget: ReadBudget) -> None:
        super().__init__(path, budget)
        self.types, self.counts = {}, None

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of `topics` in blocks; None selects all topics.

        Raises
        ------
        BagError
            If rosbags cannot open the file, or reading it exceeds the limits of memory or time.
        """
        size = self._checked_size()
        process = self._started(size, topics)
        count = 0
        end: dict[str, Any] = {}
        try:
            for block in self._received(process, end):
                self._budget.spend(sum(block.payloads.sizes.tolist()))
                count += len(block.payloads)
                yield block
        finally:
            process.kill()
            process.communicate()
        if error := end['error']:
            if not count:
                repair = _REPAIRS[self.path.suffix]
                raise BagError(
                    f'the file {self.path} cannot be read: {error}; copy it again, or '
                    f'repair it ({repair})'
                )
            self._report.add(
                f'the file is damaged ({error}): only the {count} messages before the damage are '
                'read'
            )
        if missing := end['missing']:
            self._report.add(
                f'the reader ignores {missing} messages with values of a wrong type, or without '
                'topic or time'
            )
        self._report.finish()

    def _checked_size(self) -> int:
        beginning, kind = _BEGINNINGS[self.path.suffix]
        with reading(self.path), self.path.open('rb') as stream:
            size = self.path.stat().st_size
            found = stream.read(len(beginning))
        if not size:
            raise BagError(f'the file {self.path} is empty: record or copy it again')
        if found != beginning:
            raise BagError(f'the file {self.path} is not {kind}: check the path')
        return size

    def _started(self, size: int, topics: Collection[str] | None) -> 'subprocess.Popen[bytes]':
        budget = self._budget
        arguments = {
            'path': str(self.path),
            'topics': None if topics is None else list(topics),
            'part_bytes': budget.part_bytes,
            'seconds': min(_MOST_SECONDS, _SECONDS + _SECONDS_PER_BYTE * size * budget.scale),
            'memory': min(_MOST_MEMORY, _MEMORY + _MEMORY_PER_BYTE * size * budget.scale),
        }
        return subprocess.Popen(
            [sys.executable, '-m', __name__, json.dumps(arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        )

    def _received(
        self, process: 'subprocess.Popen[bytes]', end: dict[str, Any]
    ) -> Iterator[MessageBlock]:
        """Yield the blocks that the reading process writes; store its final report in `end`."""
        stream = process.stdout
        assert stream
        names: list[str] = []
        while len(head := stream.read(_HEAD.size)) == _HEAD.size:
            index, count, size = _HEAD.unpack(head)
            content = stream.read(size)
            if index == _END:
                end.update(json.loads(content))
                break
            if index == _TOPICS:
                known = json.loads(content)
                names = [name for name, _, _ in known]
                self.types = {name: kind for name, kind, _ in known}
                self.counts = {name: messages for name, _, messages in known}
                continue
            times, sizes = np.frombuffer(content, np.int64, 2 * count).reshape(2, count)
            starts = 16 * count + np.cumsum(sizes) - sizes
            yield MessageBlock(
                names[index],
                self.types[names[index]],
                times,
                np.zeros(count, np.int64),
                Payloads(content, starts, sizes),
            )
        if not end:
            end['limit'] = 'time' if process.wait() == -signal.SIGXCPU else 'memory'
        if end['limit']:
            raise BagError(
                f'reading the file {self.path} takes more {end["limit"]} than the limit for its '
                'size. The file may be damaged or malicious; if you trust it, raise the limit '
                "'ratio'"
            )


def _write(index: int, count: int, *parts: bytes) -> None:
    stream = sys.stdout.buffer
    stream.write(_HEAD.pack(index, count, sum(map(len, parts))))
    for part in parts:
        stream.write(part)


class _Sender:
    """Queue of messages per topic; the queue is written to standard output in blocks."""

    def __init__(self, names: list[str]) -> None:
        self._indexes = {name: index for index, name in enumerate(names)}
        self._waiting: list[list[tuple[int, bytes]]] = [[] for _ in names]
        self._held = 0

    def add(self, topic: str, log_time: int, payload: bytes) -> None:
        """Queue a message; raise an error for a value of a wrong type, which SQLite allows."""
        index = self._indexes[topic]
        messages = self._waiting[index]
        _NUMBER.pack(log_time)
        messages.append((log_time, bytes(payload)))
        self._held += len(payload)
        if len(messages) == _BLOCK or self._held > _BLOCK_BYTES:
            self._send(index)

    def finish(self) -> None:
        """Write all queued messages."""
        for index in range(len(self._waiting)):
            self._send(index)

    def _send(self, index: int) -> None:
        messages = self._waiting[index]
        if not messages:
            return
        numbers = [time for time, _ in messages] + [len(payload) for _, payload in messages]
        packed = struct.pack(f'<{len(numbers)}q', *numbers)
        _write(index, len(messages), packed, *(payload for _, payload in messages))
        self._held -= sum(len(payload) for _, payload in messages)
        messages.clear()


def _read(path: Path, topics: Collection[str] | None, part_bytes: int) -> int:
    """Write the messages of a file to standard output; return the number of unreadable messages."""
    from rosbags import rosbag1, rosbag2
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_typestore

    # Exceptions that a damaged message or a value of a wrong type raises.
    damage = (SerdeError, AssertionError, TypeError, ValueError, LookupError, struct.error)
    of_ros1 = path.suffix == '.bag'
    store = get_typestore(Stores.ROS2_JAZZY)
    with rosbag1.Reader(path) if of_ros1 else rosbag2.Reader(path) as reader:
        if len(reader.connections) > MOST_TOPICS:
            raise ValueError(
                f'the bag has more than {MOST_TOPICS} topics: check whether it is damaged'
            )
        known = {name: info for name, info in reader.topics.items() if len(name) < _LONGEST_NAME}
        described = [(name, str(t.msgtype or ''), t.msgcount) for name, t in known.items()]
        _write(_TOPICS, 0, json.dumps(described).encode())
        wanted = [c for c in reader.connections if topics is None or c.topic in topics]
        missing: int = sum(connection.msgcount for connection in wanted)
        missing += reader.message_count - sum(c.msgcount for c in reader.connections)
        sender = _Sender(list(known))
        try:
            for connection, log_time, payload in reader.messages(wanted) if wanted else ():
                with contextlib.suppress(*damage):
                    if of_ros1 and connection.msgtype in store.types:
                        payload = store.ros1_to_cdr(payload, connection.msgtype)
                    if len(payload) <= part_bytes:
                        sender.add(connection.topic, log_time, payload)
                        missing -= 1
        finally:
            sender.finish()
    return missing


def _limit(seconds: float, memory: float) -> None:
    status = Path('/proc/self/status').read_text()
    (data,) = (line.split()[1] for line in status.splitlines() if line.startswith('VmData:'))
    bound = int(data) * 1024 + int(memory)
    resource.setrlimit(resource.RLIMIT_DATA, (bound, bound))
    resource.setrlimit(resource.RLIMIT_FSIZE, (bound, bound))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))


def main(arguments: str) -> None:
    """Read the bag file named in `arguments` (JSON), and write its messages to standard output."""
    values = json.loads(arguments)
    end = {'error': '', 'limit': '', 'missing': 0}
    _limit(values['seconds'], values['memory'])
    try:
        end['missing'] = _read(Path(values['path']), values['topics'], values['part_bytes'])
    except MemoryError:
        end['limit'] = 'memory'
    except Exception as error:  # rosbags raises exceptions of Python and SQLite
        if type(error.__cause__ or error).__name__ in _OF_LIMITS:
            end['limit'] = 'memory'
        end['error'] = ' '.join(str(error).split())[:_LONGEST_ERROR] or type(error).__name__
    _write(_END, 0, json.dumps(end).encode())
    sys.stdout.flush()


if __name__ == '__main__':
    main(sys.argv[1])
