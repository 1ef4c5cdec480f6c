"""Writer of a rosbag2 directory; the bag stays readable if the recorder is killed."""

import fcntl
import io
import os
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import yaml

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.mcap_writer import McapWriter, message_definition
from aerarm_msgs_py.storage.read_limits import BagError

_VERSION = 9  # the version that ROS 2 Jazzy writes


@dataclass
class BagMetadata:
    """Metadata of a bag that `ros2 bag info` displays.

    Attributes
    ----------
    file
        Name of the bag's only file.
    counts
        Number of messages of each topic.
    start, end
        First and last time of reception [ns]; None without messages.
    """

    file: str
    topics: Sequence[RecordedTopic]
    counts: list[int] = field(init=False)
    start: int | None = None
    end: int | None = None

    def __post_init__(self) -> None:
        self.counts = [0] * len(self.topics)

    def add(self, topic: int, log_time: int) -> None:
        """Count a stored message, and update the bag's first and last time of reception."""
        self.counts[topic] += 1
        self.start = log_time if self.start is None else min(self.start, log_time)
        self.end = log_time if self.end is None else max(self.end, log_time)

    def to_yaml(self) -> str:
        """Return the text of metadata.yaml."""
        content = {'rosbag2_bagfile_information': self._information()}
        return yaml.dump(content, Dumper=_NoAliases, sort_keys=False)

    def serialized(self) -> str:
        """Return the metadata text that rosbag2 stores inside the MCAP file."""
        return yaml.dump(self._information(), Dumper=_NoAliases, sort_keys=False)

    def _information(self) -> dict[str, object]:
        start = self.start or 0
        extent = {
            'duration': {'nanoseconds': (self.end or 0) - start},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(self.counts),
        }
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **extent,
            'topics_with_message_count': [
                {'topic_metadata': _topic_metadata(topic), 'message_count': count}
                for topic, count in zip(self.topics, self.counts, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file],
            'files': [{'path': self.file, **extent}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }


class _NoAliases(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """YAML dumper without anchors, which rosbag2's parser does not support."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _topic_metadata(topic: RecordedTopic) -> dict[str, object]:
    return {
        'name': topic.name,
        'type': topic.type,
        'serialization_format': 'cdr',
        'offered_qos_profiles': [topic.qos_profile()],
        'type_description_hash': message_definition(topic.type).hash,
    }


class _TimedFile(io.FileIO):
    """File that measures the total time of its writes."""

    seconds = 0.0

    def write(self, content: Any, /) -> int:
        begin = time.monotonic()
        written = super().write(content)
        self.seconds += time.monotonic() - begin
        return written


_CHUNK_PERIOD = 0.2  # [s]
_CHUNK_SIZE = 2**20  # [bytes]
_METADATA_PERIOD = 1.0  # [s]
# [ns] Longest delay of a message in the queue behind a later received one.
_DISORDER = 20_000_000
_LOG_TIME = attrgetter('log_time')


class BagWriter:
    """Writer of a rosbag2 directory with one MCAP file and metadata.yaml, as in ROS 2 Jazzy.

    `write` only queues the message. Every 0.2 s a thread compresses the queued messages and stores
    them in order of reception. If the process is killed, little more than the last 0.2 s is lost.
    `ros2 bag info`, `ros2 bag play` and every MCAP reader can open the bag of a killed process.
    While a bag is being written, its MCAP file is locked (`flock`), see `is_being_written`.

    Parameters
    ----------
    directory
        Directory of the bag, created with its parents; must not exist.
    topics
        All topics of the bag; messages refer to them by index.
    compression
        'zstd', 'lz4' or 'none'.

    Raises
    ------
    BagError
        If the directory exists or cannot be created.
    """

    def __init__(
        self, directory: Path | str, topics: Sequence[RecordedTopic], compression: str = 'zstd'
    ) -> None:
        self.directory = Path(directory)
        self._metadata = BagMetadata(f'{self.directory.resolve().name}_0.mcap', topics)
        try:
            self.directory.mkdir(parents=True)
            self._file = _TimedFile(self.directory / self._metadata.file, 'xb')
            self._stream: io.BufferedWriter = io.BufferedWriter(self._file)
            with suppress(OSError):  # a file system without locks
                fcntl.flock(self._stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._writer = McapWriter(self._stream, topics, compression)
            self._store_metadata()
        except FileExistsError:
            raise BagError(
                f'the directory {self.directory} already exists: choose another directory'
            ) from None
        except OSError as error:
            raise self._error(error) from error
        self._queue: deque[RecordedMessage] = deque()
        self._held: list[RecordedMessage] = []
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name='bag_writer', daemon=True)
        self._thread.start()

    @property
    def counts(self) -> list[int]:
        """Number of messages stored so far, one entry per topic."""
        return list(self._metadata.counts)

    @property
    def waiting(self) -> int:
        """Number of messages that are queued but not stored yet."""
        return len(self._queue)

    @property
    def disk_time(self) -> float:
        """Total time [s] of all writes to the disk so far."""
        return self._file.seconds

    def fileno(self) -> int:
        """Return the file descriptor of the MCAP file."""
        return self._stream.fileno()

    def write(self, message: RecordedMessage) -> None:
        """Queue a message without waiting for the disk.

        Raises
        ------
        BagError
            If storing failed, for example because the disk is full. Messages stored before stay
            readable.
        """
        self._check()
        self._queue.append(message)

    def close(self) -> None:
        """Store all queued messages and complete the bag; a second call does nothing.

        Raises
        ------
        BagError
            If storing failed.
        """
        if self._stream.closed:
            return
        self._closing.set()
        self._thread.join()
        try:
            if self._failure is None:
                self._writer.finish(self._metadata.serialized())
                os.fsync(self._stream.fileno())
            self._store_metadata()
        except OSError as error:
            self._failure = error
        with suppress(OSError):  # the same error again
            self._stream.close()
        self._check()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check(self) -> None:
        if self._failure is not None:
            raise self._error(self._failure) from self._failure

    def _error(self, error: Exception) -> BagError:
        reason = getattr(error, 'strerror', None) or error
        return BagError(
            f'the bag {self.directory} cannot be written ({reason}): check the path, its '
            'permissions and the free space'
        )

    def _work(self) -> None:
        metadata_due = time.monotonic() + _METADATA_PERIOD
        closing = False
        try:
            while not closing:
                closing = self._closing.wait(_CHUNK_PERIOD)
                self._store_queue(everything=closing)
                if time.monotonic() > metadata_due:
                    self._store_metadata()
                    metadata_due = time.monotonic() + _METADATA_PERIOD
        except Exception as error:  # after any exception the queued messages cannot be stored
            self._failure = error

    def _store_queue(self, *, everything: bool) -> None:
        """Store the queued messages in order of reception.

        The newest messages wait until the next call, because an older one may still arrive.
        Readers without an index rely on the order.
        """
        queue = self._queue
        arrived = [queue.popleft() for _ in range(len(queue))]
        ordered = sorted(self._held + arrived, key=_LOG_TIME)
        limit = max(
            [message.log_time for message in self._held]
            + [message.log_time - _DISORDER for message in arrived],
            default=0,
        )
        count = len(ordered) if everything else bisect_right(ordered, limit, key=_LOG_TIME)
        self._held = ordered[count:]
        for chunk in _chunks(ordered[:count]):
            self._writer.add_chunk(chunk)
            for message in chunk:
                self._metadata.add(message.topic, message.log_time)

    def _store_metadata(self) -> None:
        """Replace metadata.yaml atomically."""
        temporary = self.directory / 'metadata.yaml.part'
        temporary.write_text(self._metadata.to_yaml())
        temporary.replace(self.directory / 'metadata.yaml')


def is_being_written(directory: Path) -> bool:
    """Return whether a running process still writes the bag with a `BagWriter`."""
    for path in directory.glob('*.mcap'):
        with path.open('rb') as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:  # a file system without locks
                continue
    return False


def _chunks(messages: Sequence[RecordedMessage]) -> Iterator[Sequence[RecordedMessage]]:
    """Split the messages into parts of about a megabyte; each part becomes one chunk."""
    start, size = 0, 0
    for stop, message in enumerate(messages, 1):
        size += len(message.payload)
        if size >= _CHUNK_SIZE or stop == len(messages):
            yield messages[start:stop]
            start, size = stop, 0
