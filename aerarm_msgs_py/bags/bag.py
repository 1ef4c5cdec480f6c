"""Reader of the files and topics of a recorded bag."""

import re
import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from aerarm_msgs_py.storage.compressed_file import SUFFIX, BagFile, CompressedFile, decompressed
from aerarm_msgs_py.storage.mcap_file import McapFile
from aerarm_msgs_py.storage.read_limits import (
    BagError,
    BagWarning,
    DamageReport,
    MessageBlock,
    ReadBudget,
    ReadLimits,
    reading,
)

FILE = 'metadata.yaml'
"""Name of a bag's metadata file."""

# All values stay texts, so no text is parsed as a number or a date, which may be slow. PyYAML's
# optional parser in C takes 2 ms instead of 20 ms.
_LOADER = getattr(yaml, 'CBaseLoader', yaml.BaseLoader)
_LARGEST = 2**20  # bytes; the metadata of a thousand topics has half of it
_DEEPEST = 16  # levels; libyaml crashes at some ten thousand
_MOST_DIGITS = 15  # of a number of messages
_OPENING = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_CLOSING = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


@dataclass(frozen=True)
class BagInformation:
    """Entries of a bag's metadata.yaml that the bag reader needs.

    Attributes
    ----------
    compression_mode
        'message' if every message is compressed separately; the reader ignores other values.
    counts
        Number of messages of each topic; None if unknown.
    """

    compression_mode: str = ''
    counts: Mapping[str, int] | None = None


def read_information(path: Path) -> BagInformation:
    """Read the metadata.yaml of a bag.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ValueError
        If the file cannot be read, is too large, is not plain YAML or not metadata of a bag.
    """
    if path.exists() and not path.is_file():
        raise ValueError(
            'this path is a directory, a pipe or a device instead of a regular file'
        )  # Reading a pipe would never end.
    try:
        with path.open('rb') as stream:
            content = stream.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise ValueError(f'the file is larger than {_LARGEST} bytes')
        text = content.decode()
        _check_depth(text)
        document = yaml.load(text, _LOADER)
    except FileNotFoundError:
        raise
    except (OSError, yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(' '.join(str(error).split())[:200]) from None
    try:
        return _information(document['rosbag2_bagfile_information'])
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f'the file is not the metadata of a bag ({error})') from None


def _check_depth(text: str) -> None:
    depth = 0
    for event in yaml.parse(text, _LOADER):
        depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
        if depth > _DEEPEST:
            raise ValueError(f'the YAML is nested more than {_DEEPEST} levels deep')


def _information(document: Any) -> BagInformation:
    mode = document.get('compression_mode', '')
    # An alias can be a nested list whose text fills the memory.
    return BagInformation(mode.lower() if isinstance(mode, str) else '', _counts(document))


def _counts(document: Any) -> dict[str, int] | None:
    """Return the number of messages of each topic; None if a number is invalid."""
    counts: dict[str, int] = {}
    topics = document.get('topics_with_message_count')
    for entry in topics if isinstance(topics, list) else ():
        try:
            name, count = entry['topic_metadata']['name'], entry['message_count']
        except (KeyError, TypeError, IndexError):
            return None
        if not isinstance(name, str) or not isinstance(count, str):
            return None
        if not (count.isascii() and count.isdecimal() and len(count) <= _MOST_DIGITS):
            return None
        counts[name] = counts.get(name, 0) + int(count)
    return counts or None


class RecordedMessage(NamedTuple):
    """Serialized message with its topic, log time, publish time and sequence number.

    Attributes
    ----------
    topic
        Index of the topic in the `topics` of the bag writer.
    payload
        Serialized message.
    log_time
        Time of receipt [ns].
    publish_time
        Time of publication [ns].
    sequence
        Publication sequence number, 0 if unknown.
    """

    topic: int
    payload: bytes
    log_time: int
    publish_time: int
    sequence: int


# rosbag2 writes "no limit" as the largest number of nanoseconds, split into seconds and remainder.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True)
class RecordedTopic:
    """Name, message type and quality of service of a topic in a bag.

    Attributes
    ----------
    name
        Full topic name, for example '/arm/joint_states'.
    type
        Message type, for example 'sensor_msgs/msg/JointState'.
    depth, reliable, latched
        Quality of service that the topic's publishers offer, which `ros2 bag play` uses.
    """

    name: str
    type: str
    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def qos_profile(self) -> dict[str, object]:
        """Return the quality of service as a mapping, as in rosbag2's metadata (version 9)."""
        return {
            'history': 'keep_last',
            'depth': self.depth,
            'reliability': 'reliable' if self.reliable else 'best_effort',
            'durability': 'transient_local' if self.latched else 'volatile',
            'deadline': dict(_INFINITE),
            'lifespan': dict(_INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_INFINITE),
            'avoid_ros_namespace_conventions': False,
        }


_OTHER_STORAGES = ('.db3', f'.mcap{SUFFIX}', f'.db3{SUFFIX}')
_MOST_NAMED = 20  # topics listed in a message
_LONGEST_NAME = 100  # characters of a topic's name in a message


class Bag:
    """Reader of a bag, which is a rosbag2 directory or a single bag file.

    `metadata.yaml` is not required, because a killed recorder may have left no such file, or an
    outdated one.

    Parameters
    ----------
    path
        Directory, .mcap or .db3 file, or ROS 1 .bag file.
    limits
        Limits of memory and time for reading.

    Attributes
    ----------
    budget
        Memory and time that the reader may still use.

    Raises
    ------
    BagError
        If the path does not exist or contains no bag.
    """

    def __init__(self, path: Path | str, limits: ReadLimits | None = None) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise BagError(f'the bag {self.path} does not exist: check its path')
        self._unused = ''  # reason why metadata.yaml is not used
        self._information = self._read_information()
        paths = self._find_paths()
        with reading(self.path, 'bag'):
            size = sum(path.stat().st_size for path in paths)
        self.budget = ReadBudget(self.path, size, limits)
        self._report = DamageReport(self.path)
        self._files = [_opened(file, self.budget) for file in paths]

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages in blocks; a block is at most one MCAP chunk.

        `topics` selects the topics; None selects all. If the bag states more messages than the
        reader finds, a warning states the difference.

        Raises
        ------
        BagError
            If a file cannot be read, or exceeds the limits.
        """
        found: dict[str, int] = {}
        for file in self._files:
            for block in self._blocks_of(file, topics):
                found[block.topic] = found.get(block.topic, 0) + len(block.payloads)
                yield block
        self._report.finish()
        if self._unused and any(file.counts is None for file in self._files):
            warnings.warn(self._unused, BagWarning, stacklevel=2)
        for topic in self.types() if topics is None else topics:
            expected = self.recorded_count(topic) or 0
            if (missing := expected - found.get(topic, 0)) > 0:
                warnings.warn(
                    f'bag {self.path}: {missing} of the {expected} messages of {topic} are missing',
                    BagWarning,
                    stacklevel=2,
                )

    def _blocks_of(self, file: BagFile, topics: Collection[str] | None) -> Iterator[MessageBlock]:
        if self._information.compression_mode != 'message':
            yield from file.blocks(topics)
            return
        for compressed in file.blocks(topics):
            block = decompressed(compressed, self._report, self.budget)
            if block is not None:
                yield block

    def messages_and(
        self, topic: str, message_type: str, others: Collection[str]
    ) -> Iterator[MessageBlock]:
        """Yield the messages of one required topic and of optional topics.

        Raises
        ------
        BagError
            If a file cannot be read, or if the required topic is missing, has no messages or not
            the given message type.
        """
        name = '/' + topic.lstrip('/')
        empty = True
        for block in self.blocks({name, *others}):
            if block.topic == name:
                self._check_type(name, block.type, message_type)
                empty = False
            yield block
        if empty:
            self._check_type(name, self.types().get(name, message_type), message_type)
            raise BagError(self._why_empty(name))

    @property
    def damaged(self) -> bool:
        """Whether the files read so far are truncated or damaged."""
        return self._report.places > 0 or any(file.damaged for file in self._files)

    def _check_type(self, topic: str, found: str, expected: str) -> None:
        if found != expected:
            raise BagError(
                f'topic {topic} of the bag {self.path} has the type {found or "(unknown)"}, not '
                f'{expected}: choose another topic'
            )

    def types(self) -> dict[str, str]:
        """Return the message type of every topic declared in the files read so far."""
        return {topic: kind for file in self._files for topic, kind in file.types.items()}

    def _why_empty(self, topic: str) -> str:
        types = self.types()
        if topic in types and (self.recorded_count(topic) or self.damaged):
            return (
                f'all messages of topic {topic} in the bag {self.path} are unreadable: copy the '
                'bag again'
            )
        if topic in types:
            return (
                f'the bag {self.path} contains no messages of topic {topic}: check that the '
                'publisher was running during the recording'
            )
        names = sorted(types)
        listed = [f'{n[:_LONGEST_NAME]} ({types[n][:_LONGEST_NAME]})' for n in names[:_MOST_NAMED]]
        if len(names) > _MOST_NAMED:
            listed.append(f'{len(names) - _MOST_NAMED} more')
        return (
            f'the bag {self.path} has no topic {topic}: choose one of '
            f'{", ".join(listed) or "no topics at all"}'
        )

    def recorded_count(self, topic: str) -> int | None:
        """Return the number of messages that the bag states for a topic; None if unknown.

        metadata.yaml contains this number; for a single file, the metadata.yaml in its directory.
        Without metadata.yaml, the number is that in the summaries of the files read so far.
        """
        if self._information.counts is not None:
            return self._information.counts.get(topic, 0)
        own = [file.counts for file in self._files]
        return None if None in own else sum(c.get(topic, 0) for c in own if c is not None)

    def _read_information(self) -> BagInformation:
        """Return the content of metadata.yaml; no entries if the file is missing or damaged."""
        folder = self.path.parent if self.path.is_file() else self.path
        try:
            information = read_information(folder / FILE)
        except FileNotFoundError:
            return BagInformation()
        except ValueError as error:
            self._unused = f'the reader ignores {folder / FILE}: {error}'
            return BagInformation()
        mine = folder == self.path or _files_in(folder) == [self.path]
        return information if mine else BagInformation()

    def _find_paths(self) -> list[Path]:
        path = self.path
        if path.is_file():
            if path.name == FILE:
                raise BagError(
                    f"{path} is the metadata file of a bag: pass the bag's directory {path.parent}"
                )
            return [path]
        files = _files_in(path)
        if not files:
            raise BagError(
                f'the directory {path} is not a bag (it contains no .mcap or .db3 file): check the '
                'path, or copy the whole directory again'
            )
        return files


def _files_in(folder: Path) -> list[Path]:
    """Return the bag files in a folder, all of one storage format, in natural order."""
    with reading(folder, 'bag'):
        names = [file for file in folder.iterdir() if file.is_file()]
    for suffixes in (('.mcap',), _OTHER_STORAGES):
        found = [file for file in names if file.name.endswith(suffixes)]
        if found:
            return sorted(found, key=_natural_order)
    return []


def _opened(path: Path, budget: ReadBudget) -> BagFile:
    if path.suffix == SUFFIX:
        return CompressedFile(path, budget, _opened)
    if path.suffix in ('.bag', '.db3'):  # of ROS 1 and SQLite
        from aerarm_msgs_py.storage.foreign_file import ForeignFile

        return ForeignFile(path, budget)
    return McapFile(path, budget)


def _natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that orders bag_2 before bag_10."""
    return [
        (int(part), '') if part.isdecimal() else (-1, part)
        for part in re.split(r'(\d+)', path.name)
    ]
