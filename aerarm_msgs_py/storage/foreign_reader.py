"""Program that reads a ROS 1 or SQLite bag file by rosbags, and writes its messages as blocks.

`ForeignFile` starts it as a separate process. The program imports neither numpy nor the suite,
because these imports would take most of the time for a small file.
"""

import contextlib
import json
import marshal
import resource
import struct
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

SIZE = struct.Struct('<Q')
"""Format of the number of bytes that precedes each item in the output."""
_BLOCK = 1000  # messages
_BLOCK_BYTES = 2**20
_LONGEST_NAME = 4096  # characters
_LONGEST_ERROR = 200  # characters
_OF_LIMITS = ('NoMemError', 'IOError', 'FullError')  # SQLite's errors of memory and temporary file


def _write(*item: Any) -> None:
    data = marshal.dumps(item)
    sys.stdout.buffer.write(SIZE.pack(len(data)))
    sys.stdout.buffer.write(data)


class _Sender:
    """Queue of messages per topic; the queue is written to standard output in blocks."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[int, bytes]]] = {}
        self._held = 0

    def add(self, topic: str, log_time: int, payload: bytes) -> None:
        """Queue a message; raise an error for a value of a wrong type, which SQLite allows."""
        struct.pack('q', log_time)
        message = log_time, bytes(payload)
        messages = self._waiting.setdefault(topic, [])
        messages.append(message)
        self._held += len(payload)
        if len(messages) == _BLOCK or self._held > _BLOCK_BYTES:
            self._held -= sum(len(waiting) for _, waiting in messages)
            _write('messages', topic, *zip(*self._waiting.pop(topic), strict=True))

    def finish(self) -> None:
        """Write all queued messages."""
        for topic, messages in self._waiting.items():
            _write('messages', topic, *zip(*messages, strict=True))


def _read(path: Path, topics: Collection[str] | None, part_bytes: int, most_topics: int) -> int:
    """Write the messages of a file to standard output; return the number of unreadable messages."""
    from rosbags.serde import SerdeError

    # Exceptions that a damaged message or a value of a wrong type raises.
    damage = (SerdeError, AssertionError, TypeError, ValueError, LookupError, struct.error)
    of_ros1 = path.suffix == '.bag'
    if of_ros1:
        from rosbags.rosbag1 import Reader
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
    else:
        from rosbags.rosbag2 import Reader
    with Reader(path) as reader:
        if len(reader.connections) > most_topics:
            raise ValueError(
                f'the bag has more than {most_topics} topics: check whether it is damaged'
            )
        known = {name: info for name, info in reader.topics.items() if len(name) < _LONGEST_NAME}
        described = [(name, str(t.msgtype or ''), t.msgcount) for name, t in known.items()]
        _write('topics', described)
        wanted = [c for c in reader.connections if topics is None or c.topic in topics]
        missing: int = sum(connection.msgcount for connection in wanted)
        missing += reader.message_count - sum(c.msgcount for c in reader.connections)
        sender = _Sender()
        try:
            for connection, log_time, payload in reader.messages(wanted) if wanted else ():
                with contextlib.suppress(*damage):
                    if of_ros1 and connection.msgtype in store.types:
                        payload = store.ros1_to_cdr(payload, connection.msgtype)
                    if len(payload) <= part_bytes and connection.topic in known:
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
        end['missing'] = _read(
            Path(values['path']), values['topics'], values['part_bytes'], values['most_topics']
        )
    except MemoryError:
        end['limit'] = 'memory'
    except Exception as error:  # rosbags raises exceptions of Python and SQLite
        if type(error.__cause__ or error).__name__ in _OF_LIMITS:
            end['limit'] = 'memory'
        end['error'] = ' '.join(str(error).split())[:_LONGEST_ERROR] or type(error).__name__
    _write('end', end)
    sys.stdout.flush()


if __name__ == '__main__':
    main(sys.argv[1])
