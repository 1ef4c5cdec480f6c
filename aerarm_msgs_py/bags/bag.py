"""A recorded bag: its files and its topics."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import yaml

from aerarm_msgs_py.bags.bag_error import BagError
from aerarm_msgs_py.bags.mcap_file import McapFile
from aerarm_msgs_py.bags.message_block import MessageBlock
from aerarm_msgs_py.bags.rosbags_file import RosbagsFile

_METADATA = 'metadata.yaml'
# The loader in C, where PyYAML has it, takes 2 ms instead of 20.
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class Bag:
    """A rosbag2 directory, or one .mcap file by itself.

    `metadata.yaml` isn't needed: a recorder that was killed may have left none, or an old one.

    Parameters
    ----------
    path
        Directory or .mcap file.

    Raises
    ------
    BagError
        If there is no such path, or nothing in it is a bag.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._information = self._read_information()
        self._files = self._find_files()

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all), about a megabyte at a time.

        Raises
        ------
        BagError
            If a file can't be read.
        """
        for file in self._files:
            yield from file.blocks(topics)

    def messages(self, topic: str, message_type: str) -> Iterator[MessageBlock]:
        """Yield the messages of one topic of known type.

        Raises
        ------
        BagError
            If a file can't be read, the topic isn't in the bag, holds no messages or has
            another type.
        """
        yield from self.messages_and(topic, message_type, ())

    def messages_and(
        self, topic: str, message_type: str, others: Collection[str]
    ) -> Iterator[MessageBlock]:
        """Yield the messages of one topic of known type, and of others if they are there.

        Errors are those of `messages`; nothing is asked of the other topics.
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
        """Whether the files read so far miss their end or hold damage."""
        return any(file.damaged for file in self._files)

    def _check_type(self, topic: str, found: str, expected: str) -> None:
        if found != expected:
            raise BagError(
                f'topic {topic} of {self.path} is of type {found or "(unknown)"}, '
                f'not {expected}: choose another topic'
            )

    def types(self) -> dict[str, str]:
        """Return the message type of every topic that the files read so far declare."""
        return {topic: kind for file in self._files for topic, kind in file.types.items()}

    def _why_empty(self, topic: str) -> str:
        types = self.types()
        if topic in types:
            return f'topic {topic} of {self.path} holds no messages: was its publisher running?'
        listed = ', '.join(f'{name} ({kind})' for name, kind in sorted(types.items()))
        return f'{self.path} has no topic {topic}; it has {listed or "no topics at all"}'

    def _find_files(self) -> list[McapFile | RosbagsFile]:
        path = self.path
        if not path.exists():
            raise BagError(f'there is no bag {path}: check the path')
        if path.is_file():
            if path.name == _METADATA:
                raise BagError(f'{path} is part of a bag: give its directory {path.parent}')
            return [McapFile(path)]
        information = self._information
        if str(information.get('compression_mode')).lower() == 'message':
            return [RosbagsFile(path)]  # every message is compressed by itself
        files = self._files_of(information)
        if files:
            return [McapFile(file) for file in files]
        names = [Path(str(name)).name for name in information.get('relative_file_paths') or ()]
        missing = [name for name in names if not (path / name).exists()]
        if missing:
            raise BagError(
                f'{path} lacks {", ".join(missing)}, which its {_METADATA} names: copy '
                'the whole directory again'
            )
        if (path / _METADATA).is_file():
            return [RosbagsFile(path)]
        raise BagError(f'{path} is not a bag: it holds neither a .mcap file nor a {_METADATA}')

    def recorded_count(self, topic: str) -> int | None:
        """Return how many messages of a topic the bag's own account lists.

        That is metadata.yaml (for a single file the one beside it, if it knows no other), or
        what the files say at their end, once they were read. None if neither says anything.
        """
        try:
            topics = self._information['topics_with_message_count']
            counts = {entry['topic_metadata']['name']: entry['message_count'] for entry in topics}
            return int(counts.get(topic, 0))
        except (KeyError, TypeError, ValueError):
            own = [file.counts for file in self._files]
            return None if None in own else sum(c.get(topic, 0) for c in own if c is not None)

    def _read_information(self) -> dict[str, Any]:
        """Return what metadata.yaml says, nothing if it is missing or broken."""
        folder = self.path.parent if self.path.is_file() else self.path
        try:
            content = yaml.load((folder / _METADATA).read_text(encoding='utf-8'), _LOADER)
            information = dict(content['rosbag2_bagfile_information'])
            names = [Path(str(name)).name for name in information.get('relative_file_paths') or ()]
            return information if folder == self.path or names == [self.path.name] else {}
        except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError):
            return {}

    def _files_of(self, information: dict[str, Any]) -> list[Path]:
        """Return the .mcap files in order; in that of the metadata if it knows them all."""
        present = sorted(self.path.glob('*.mcap'), key=_natural_order)
        names = information.get('relative_file_paths') or ()
        listed = [self.path / Path(str(name)).name for name in names]
        # A killed recorder may have begun a file that its last metadata doesn't know yet.
        return listed if set(listed) == set(present) else present


def _natural_order(path: Path) -> list[tuple[int, str]]:
    """Order bag_2 before bag_10."""
    return [
        (int(part), '') if part.isdigit() else (-1, part) for part in re.split(r'(\d+)', path.name)
    ]
