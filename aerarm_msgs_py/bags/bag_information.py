"""Reader for the metadata.yaml of a bag."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

FILE = 'metadata.yaml'
"""Name of a bag's metadata file."""

# PyYAML's optional parser in C takes 2 ms instead of 20 ms.
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_LARGEST = 2**20  # bytes; the metadata of a thousand topics has half of it
_DEEPEST = 16
_LONGEST_NAME = 255  # bytes of a file name
_MOST_MESSAGES = 2**53
_LONGEST_NUMBER = 64  # characters
_NUMBER = re.compile(r'[-+]?[0-9][0-9a-fA-FxXob_:.+-]*')
_OPENING = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_CLOSING = (yaml.MappingEndEvent, yaml.SequenceEndEvent)
# Exceptions of PyYAML for a value that contradicts its form or tag, such as an empty !!int.
_OF_A_TAG = (TypeError, AttributeError, LookupError, RecursionError, OverflowError)


@dataclass(frozen=True)
class BagInformation:
    """Content of metadata.yaml that readers need.

    Attributes
    ----------
    files
        Names of the bag's files, without directories.
    compression_mode
        'message' if every message is compressed separately; other values have no meaning.
    counts
        Number of messages of each topic; None if unknown.
    """

    files: tuple[str, ...] = ()
    compression_mode: str = ''
    counts: Mapping[str, int] | None = field(default=None)


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
        raise ValueError('not a regular file')  # Reading a pipe would never end.
    try:
        with path.open('rb') as stream:
            content = stream.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise ValueError(f'larger than {_LARGEST} bytes')
        text = content.decode()
        _check_plain(text)
        document = yaml.load(text, _LOADER)
    except FileNotFoundError:
        raise
    except (OSError, yaml.YAMLError, ValueError, *_OF_A_TAG) as error:
        if 'nesting depth' in str(error):  # The limit of libyaml is smaller than ours.
            raise ValueError(f'nested more than {_DEEPEST} levels deep') from None
        raise ValueError(' '.join(str(error).split())[:200]) from None
    try:
        return _information(document['rosbag2_bagfile_information'])
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f'not the metadata of a bag ({error})') from None


def _check_plain(text: str) -> None:
    """Reject YAML that becomes large or slow: aliases, deep nesting, long numbers."""
    depth = 0
    for event in yaml.parse(text, _LOADER):
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None):
            raise ValueError('the file has YAML anchors or aliases, which no recorder writes')
        depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
        if depth > _DEEPEST:
            raise ValueError(f'nested more than {_DEEPEST} levels deep')
        if isinstance(event, yaml.ScalarEvent) and _is_long_number(event):
            raise ValueError(
                f'the file contains a number that is {len(event.value)} characters long'
            )


def _is_long_number(event: Any) -> bool:
    """Return whether a text may be a number that takes long to read, by its form or tag.

    Reading a number in base 60 takes a time proportional to the square of its length.
    """
    long = len(event.value) > _LONGEST_NUMBER
    return long and (event.tag is not None or _NUMBER.fullmatch(event.value) is not None)


def _information(document: Any) -> BagInformation:
    files = document.get('relative_file_paths') or []
    if not isinstance(files, list) or not all(isinstance(name, str) for name in files):
        raise TypeError('relative_file_paths')
    names = [Path(name).name for name in files]
    return BagInformation(
        tuple(dict.fromkeys(name for name in names if _is_file_name(name))),
        str(document.get('compression_mode') or '').lower(),
        _counts(document),
    )


def _is_file_name(name: str) -> bool:
    return name not in ('', '..') and '\0' not in name and len(name.encode()) <= _LONGEST_NAME


def _counts(document: Any) -> dict[str, int] | None:
    """Return the message counts, None if one is invalid."""
    counts: dict[str, int] = {}
    for name, count in _entries(document):
        if not isinstance(name, str) or isinstance(count, bool) or not isinstance(count, int):
            return None
        if not 0 <= count <= _MOST_MESSAGES:
            return None
        counts[name] = counts.get(name, 0) + count
    return counts or None


def _entries(document: Any) -> Iterator[tuple[Any, Any]]:
    topics = document.get('topics_with_message_count')
    for entry in topics if isinstance(topics, list) else ():
        try:
            yield entry['topic_metadata']['name'], entry['message_count']
        except (KeyError, TypeError, IndexError):
            yield None, None
