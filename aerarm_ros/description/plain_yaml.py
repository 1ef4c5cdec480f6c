"""YAML that anybody may have written: plain data of bounded size, depth and numbers."""

import re
from pathlib import Path
from typing import Any

import yaml

from aerarm_ros.description.config_error import ConfigError

LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""Loader of plain data; the one in C, where PyYAML has it, takes a tenth of the time."""

_LARGEST = 2**20  # bytes; the largest file of the suite has a tenth of it
_DEEPEST = 20
_LONGEST_NUMBER = 64  # characters
_NUMBER = re.compile(r'[-+]?[0-9][0-9a-fA-FxXob_:.+-]*')
_OPENING = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_CLOSING = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


class UniqueKeyLoader(LOADER):  # type: ignore[misc]
    """Reads plain data only, and refuses a key given twice (YAML forbids it, PyYAML doesn't)."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping, after a look for repeated keys."""
        seen = set()
        for key_node, _ in node.value:
            key = getattr(key_node, 'value', None)
            if isinstance(key, str) and key in seen:
                line = key_node.start_mark.line + 1
                raise ConfigError(f'line {line}: key {key[:100]} is given twice')
            seen.add(key if isinstance(key, str) else id(key_node))
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found


def read_plain(path: Path, loader: Any = UniqueKeyLoader) -> Any:
    """Read a YAML file, see `plain_data`.

    Raises
    ------
    OSError
        If it can't be read.
    ConfigError
        If it is too large or isn't plain YAML.
    """
    with path.open('rb') as stream:
        content = stream.read(_LARGEST + 1)
    try:
        return plain_data(content.decode(), loader)
    except UnicodeDecodeError as error:
        raise ConfigError(f'not valid YAML: {error}') from None


def plain_data(text: str, loader: Any = UniqueKeyLoader) -> Any:
    """Return what a YAML text means.

    Parameters
    ----------
    text : str
    loader : type
        `LOADER` or what derives from it.

    Raises
    ------
    ConfigError
        If it isn't YAML, gives a key twice, has anchors or aliases (by which a small text becomes
        endless data), more bytes, deeper nesting or longer numbers than any configuration.
    """
    if len(text) > _LARGEST:
        raise ConfigError(f'has more than {_LARGEST} bytes, which no configuration has')
    try:
        _check_events(text)
        return yaml.load(text, Loader=loader)
    except ConfigError:
        raise
    except yaml.YAMLError as error:
        raise ConfigError(f'not valid YAML: {" ".join(str(error).split())}') from None
    except (ValueError, TypeError, AttributeError, LookupError, OverflowError) as error:
        # Of a value that isn't what its form or its tag says, such as 2001-99-99.
        raise ConfigError(f'not valid YAML: {" ".join(str(error).split())}') from None


def _check_events(text: str) -> None:
    """Look through a text without building anything; needs no recursion, whatever its depth."""
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        reason = ''
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None):
            reason = 'anchors and aliases are not read: write it out'
        depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
        if depth > _DEEPEST:
            reason = f'nested more than {_DEEPEST} deep'
        if isinstance(event, yaml.ScalarEvent) and _is_long_number(event):
            reason = f'a number of {len(event.value)} characters'
        if reason:
            line = event.start_mark.line + 1 if event.start_mark else 0
            raise ConfigError(f'line {line}: {reason}')


def _is_long_number(event: Any) -> bool:
    """Tell whether a text is a long number by its form, or may be one by its tag."""
    long = len(event.value) > _LONGEST_NUMBER
    return long and (event.tag is not None or _NUMBER.fullmatch(event.value) is not None)
