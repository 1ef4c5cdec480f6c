"""A recorded bag: its files and its topics."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import yaml

from aerarm_msgs_py.bag_error import BagError
from aerarm_msgs_py.mcap_file import McapFile
from aerarm_msgs_py.message_block import MessageBlock
from aerarm_msgs_py.rosbags_file import RosbagsFile

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
        name = '/' + topic.lstrip('/')
        empty = True
        for block in self.blocks((name,)):
            if block.type != message_type:
                raise BagError(
                    f'topic {name} of {self.path} is of type {block.type or "(unknown)"}, '
                    f'not {message_type}: choose another topic'
                )
            empty = False
            yield block
        if empty:
            raise BagError(self._why_empty(name))

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
        information = self._information()
        if str(information.get('compression_mode')).lower() == 'message':
            return [RosbagsFile(path)]  # every message is compressed by itself
        files = self._files_of(information)
        if files:
            return [McapFile(file) for file in files]
        if (path / _METADATA).is_file():
            return [RosbagsFile(path)]
        raise BagError(f'{path} is not a bag: it holds neither a .mcap file nor a {_METADATA}')

    def _information(self) -> dict[str, Any]:
        """Return what metadata.yaml says, nothing if it is missing or broken."""
        try:
            content = yaml.load((self.path / _METADATA).read_text(), _LOADER)
            return dict(content['rosbag2_bagfile_information'])
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
