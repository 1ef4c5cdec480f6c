"""Recording into a rosbag2 directory that survives being killed."""

import io
import os
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import yaml

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.mcap_writer import COMPRESSIONS, McapWriter, message_definition
from aerarm_msgs_py.storage.read_limits import BagError

_VERSION = 9  # as ROS 2 Jazzy writes it


@dataclass
class BagMetadata:
    """Metadata of a bag, as `ros2 bag info` shows it.

    Attributes
    ----------
    file
        Name of the bag's one file.
    topics
        Its topics.
    counts
        Messages of each topic.
    start, end
        First and last time of reception [ns]; None while there are no messages.
    """

    file: str
    topics: Sequence[RecordedTopic]
    counts: list[int] = field(init=False)
    start: int | None = None
    end: int | None = None

    def __post_init__(self) -> None:
        self.counts = [0] * len(self.topics)

    def add(self, topic: int, log_time: int) -> None:
        """Count a message."""
        self.counts[topic] += 1
        if self.start is None or self.end is None:
            self.start = self.end = log_time
        elif log_time > self.end:
            self.end = log_time
        elif log_time < self.start:
            self.start = log_time

    def to_yaml(self) -> str:
        """Return the file's text."""
        content = {'rosbag2_bagfile_information': self._information()}
        return yaml.dump(content, Dumper=_NoAliases, sort_keys=False)

    def serialized(self) -> str:
        """Return the text that rosbag2 also puts into the MCAP file."""
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
    """Dumper without anchors, which rosbag2's parser has no use for."""

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
    """A file that measures how long its writes take."""

    seconds = 0.0

    def write(self, content: Any, /) -> int:
        begin = time.monotonic()
        written = super().write(content)
        self.seconds += time.monotonic() - begin
        return written


_CHUNK_PERIOD = 0.2  # [s]
_CHUNK_SIZE = 2**20  # [bytes]
_METADATA_PERIOD = 1.0  # [s]
# A message may be queued this much later than another one that was received after it [ns].
_DISORDER = 20_000_000
_LOG_TIME = attrgetter('log_time')


class BagWriter:
    """A rosbag2 directory with one MCAP file and metadata.yaml, as ROS 2 Jazzy has it.

    `write` only puts the message into a queue; a thread compresses and stores what came in
    the last 0.2 s, in order of reception. A process that is killed loses little more than
    that, and leaves a bag that `ros2 bag info`, `ros2 bag play` and every MCAP reader open.

    Parameters
    ----------
    directory
        Where the bag goes; made with its parents, must not exist.
    topics
        All topics of the bag; messages name them by index.
    compression
        'zstd', 'lz4' or 'none'.

    Raises
    ------
    BagError
        If the directory exists or can't be made, or the compression isn't known.
    """

    def __init__(
        self, directory: Path | str, topics: Sequence[RecordedTopic], compression: str = 'zstd'
    ) -> None:
        if compression not in COMPRESSIONS:
            raise BagError(f'compression {compression!r}: choose one of {", ".join(COMPRESSIONS)}')
        self.directory = Path(directory)
        self._metadata = BagMetadata(f'{self.directory.resolve().name}_0.mcap', topics)
        self._make_directory()
        try:
            self._stream = _TimedFile(self.directory / self._metadata.file, 'xb')
            self._writer = McapWriter(self._stream, topics, compression)
            self._store_metadata()
        except OSError as error:
            raise BagError(f'{self.directory} cannot be written: {error.strerror}') from error
        self._queue: deque[RecordedMessage] = deque()
        self._held: list[RecordedMessage] = []
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name='bag_writer', daemon=True)
        self._thread.start()

    @property
    def counts(self) -> list[int]:
        """Messages of each topic that are stored."""
        return list(self._metadata.counts)

    @property
    def waiting(self) -> int:
        """Messages that are queued and not stored."""
        return len(self._queue)

    @property
    def disk_time(self) -> float:
        """Time that writing to the disk has taken so far [s]."""
        return self._stream.seconds

    def fileno(self) -> int:
        """Return the descriptor of the MCAP file."""
        return self._stream.fileno()

    def write(self, message: RecordedMessage) -> None:
        """Queue a message; never waits for the disk.

        Raises
        ------
        BagError
            If storing failed, for example because the disk is full. What was stored before
            stays readable.
        """
        self._check()
        self._queue.append(message)

    def close(self) -> None:
        """Store everything queued and complete the bag; a second call does nothing.

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
        finally:
            self._stream.close()
        self._check()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check(self) -> None:
        if self._failure is not None:
            reason = getattr(self._failure, 'strerror', None) or self._failure
            raise BagError(f'{self.directory} cannot be written: {reason}') from self._failure

    def _make_directory(self) -> None:
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise BagError(
                f'{self.directory} exists and is not overwritten: choose another directory'
            ) from None
        except OSError as error:
            raise BagError(
                f'{self.directory} cannot be made ({error.strerror}): check path and permissions'
            ) from error

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
        except Exception as error:  # whatever it is, nobody would store what is queued now
            self._failure = error

    def _store_queue(self, *, everything: bool) -> None:
        """Store what was queued by now, in order of reception.

        The newest messages are held back until the next time, as an older one may still
        come; readers without an index rely on the order.
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
        """Replace metadata.yaml in one step, so that it is never half written."""
        temporary = self.directory / 'metadata.yaml.part'
        temporary.write_text(self._metadata.to_yaml())
        temporary.replace(self.directory / 'metadata.yaml')


def _chunks(messages: Sequence[RecordedMessage]) -> Iterator[Sequence[RecordedMessage]]:
    """Yield the messages in parts of about a megabyte."""
    start, size = 0, 0
    for stop, message in enumerate(messages, 1):
        size += len(message.payload)
        if size >= _CHUNK_SIZE or stop == len(messages):
            yield messages[start:stop]
            start, size = stop, 0
