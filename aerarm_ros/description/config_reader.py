"""From a YAML mapping to a frozen dataclass, with errors that name the key."""

import dataclasses
import math
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from aerarm_ros.description.resources import find_file, resource


class DescriptionError(ValueError):
    """Unusable URDF; the message names the joint or link and what to do."""


class ConfigError(ValueError):
    """Unusable configuration; the message names the key and its allowed values."""


def check_range(owner: str, key: str, value: float, low: float, high: float, unit: str) -> None:
    """Require `low <= value <= high`.

    The ranges are wide: they catch NaN and values in a wrong unit, not poor choices.

    Raises
    ------
    ConfigError
        If the value is outside, not finite, or not a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{owner}: {key} must be a number, not {value!r}')
    if not (math.isfinite(value) and low <= value <= high):
        unit_text = f' [{unit}]' if unit else ''
        raise ConfigError(
            f'{owner}: {key} = {value} must lie in {low:g} .. {high:g}{unit_text}; check the '
            'number and its unit'
        )


def check_choice(owner: str, key: str, value: object, choices: tuple[object, ...]) -> None:
    """Require that `value` is one of `choices`.

    Raises
    ------
    ConfigError
        If it is another; the message lists the choices.
    """
    if isinstance(value, bool) or value not in choices:
        listed = ', '.join(str(choice) for choice in choices)
        raise ConfigError(f'{owner}: {key} = {value!r} must be one of {listed}')


def check_name(owner: str, key: str, value: object) -> None:
    """Require a text that isn't empty.

    Raises
    ------
    ConfigError
        If it is empty or no text.
    """
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f'{owner}: {key} = {value!r} must be a name')


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
                raise ConfigError(f'line {line}: key {key[:100]} is given twice, remove one')
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
    """Return the data of a YAML text.

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
        raise ConfigError(f'the file is larger than {_LARGEST} bytes, more than any configuration')
    try:
        _check_events(text)
        return yaml.load(text, Loader=loader)
    except ConfigError:
        raise
    except yaml.YAMLError as error:
        # libyaml has a limit of its own, and meets it before `_check_events` sees the nesting.
        if 'nesting depth' in str(error):
            raise ConfigError(f'nested more than {_DEEPEST} levels deep') from None
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
            reason = 'YAML anchors and aliases are not supported, write the values out'
        depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
        if depth > _DEEPEST:
            reason = f'nested more than {_DEEPEST} levels deep'
        if isinstance(event, yaml.ScalarEvent) and _is_long_number(event):
            reason = f'the number has {len(event.value)} characters'
        if reason:
            line = event.start_mark.line + 1 if event.start_mark else 0
            raise ConfigError(f'line {line}: {reason}')


def _is_long_number(event: Any) -> bool:
    """Tell whether a text is a long number by its form, or may be one by its tag."""
    long = len(event.value) > _LONGEST_NUMBER
    return long and (event.tag is not None or _NUMBER.fullmatch(event.value) is not None)


_LONGEST = 64  # characters
_PREFIX = re.compile(r'([A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*/?)?')


def check_prefix(prefix: str) -> None:
    """Require a prefix with which every name is one that ROS's frames may have.

    Raises
    ------
    DescriptionError
        If it holds anything but letters, digits, underscores and single slashes, begins with
        another than a letter, or is very long. Nothing at all is fine.
    """
    if len(prefix) > _LONGEST or not _PREFIX.fullmatch(prefix):
        raise DescriptionError(
            f'tf_prefix {prefix[:_LONGEST]!r} must begin with a letter and contain only letters, '
            'digits, _ and single /, for example left_'
        )


Config = TypeVar('Config')

_FRACTION = re.compile(r'([-+]?\d{1,15})/(\d{1,15})')
_LONGEST_SHOWN = 100  # characters of a wrong value in a message


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds one mapping.

    Raises
    ------
    ConfigError
        If it can't be read, isn't plain YAML, repeats a key or holds something else.
    """
    try:
        document = read_plain(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(
            f'{path} cannot be read ({reason}): check the path and its permissions'
        ) from None
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None
    if not isinstance(document, dict):
        raise ConfigError(
            f'{path}: the file must contain a mapping of keys, compare with the packaged example'
        )
    return document


def config_path(path: Path | str | None, packaged: str) -> Path:
    """Return the file of a configuration: the packaged one in config/ if `path` is None."""
    return resource('config', packaged) if path is None else find_file(path)


def load(
    path: Path | str | None, packaged: str, make: Callable[[dict[str, Any]], Config]
) -> Config:
    """Return what `make` makes of a YAML file, by default of the packaged one in config/.

    Raises
    ------
    ConfigError
        If the file can't be read or says something wrong; one line, with file and key.
    """
    source = config_path(path, packaged)
    document = read_yaml(source)
    try:
        return make(document)
    except ConfigError as error:
        raise ConfigError(f'{source}: {error}') from None


def section(document: dict[str, Any], key: str, kind: type) -> Any:
    """Return `document[key]`, required to be a list or mapping (`kind`) with something in it."""
    value = document[key]
    if not isinstance(value, kind) or not value:
        name = 'mapping' if kind is dict else 'list'
        raise ConfigError(f'{key} must be a non-empty {name}')
    return value


def check_keys(where: str, entry: Any, config: type, also: tuple[str, ...] = ()) -> None:
    """Require that `entry` is a mapping with the fields of `config` (and `also`), no others.

    Raises
    ------
    ConfigError
        If it isn't a mapping, or a key is missing or unknown.
    """
    if not isinstance(entry, dict):
        raise ConfigError(f'{where} must be a mapping of keys, not {entry!r}')
    fields = dataclasses.fields(config)
    known = [field.name for field in fields] + list(also)
    required = [f.name for f in fields if f.default is dataclasses.MISSING] + list(also)
    unknown = [str(key) for key in entry if key not in known]
    if unknown:
        raise ConfigError(
            f'{where} has the unknown key {", ".join(unknown)}: its keys are {", ".join(known)}'
        )
    missing = [key for key in required if key not in entry]
    if missing:
        raise ConfigError(f'{where} lacks the key {", ".join(missing)}')


def build(config: type[Config], where: str, entry: Any, **given: Any) -> Config:
    """Build the dataclass `config` from a mapping read from YAML.

    Parameters
    ----------
    config : type
        A dataclass whose fields are float, int, bool, str, optional floats or tuples of floats;
        a field of another type must be given ready-made.
    where : str
        Place in the file, for messages.
    entry : mapping
        One key a field; fields with a default may be left out.
    **given
        Fields known from elsewhere, such as the key under which the entry stood.

    Raises
    ------
    ConfigError
        If a key is unknown or missing or its value isn't of the field's type, or from the
        dataclass's own checks.
    """
    if not isinstance(entry, dict):
        raise ConfigError(f'{where} must be a mapping of keys, not {entry!r}')
    repeated = [key for key in given if key in entry]
    if repeated:
        raise ConfigError(
            f'{where}: the key {", ".join(repeated)} follows from the place of the entry, delete it'
        )
    values = {**entry, **given}
    check_keys(where, values, config)
    hints = get_type_hints(config)
    converted = {
        key: _convert(f'{where}: {key}', value, hints[key]) for key, value in values.items()
    }
    return config(**converted)


def _convert(where: str, value: Any, hint: Any) -> Any:
    if isinstance(hint, types.UnionType):
        inner = [option for option in get_args(hint) if option is not types.NoneType]
        return None if value is None else _convert(where, value, inner[0])
    if hint is float:
        return _number(where, value)
    if hint is bool:
        if not isinstance(value, bool):
            raise ConfigError(f'{where} must be true or false, not {value!r}')
        return value
    if hint is int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise ConfigError(f'{where} must be a whole number, not {value!r}')
        return value
    if get_origin(hint) is tuple and get_args(hint)[0] is float:
        if not isinstance(value, list | tuple):
            raise ConfigError(f'{where} must be a list of numbers, not {value!r}')
        return tuple(_number(where, item) for item in value)
    return value


def _number(where: str, value: Any) -> float:
    """Return a float; texts such as '1/31' and '1e-5' (which YAML 1.1 takes for text) count."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str):
        fraction = _FRACTION.fullmatch(value.strip())
        try:
            number = int(fraction[1]) / int(fraction[2]) if fraction else float(value)
            if math.isfinite(number):
                return number
        except (ValueError, ZeroDivisionError):
            pass
    shown = value if len(str(value)) < _LONGEST_SHOWN else f'{str(value)[:_LONGEST_SHOWN]}...'
    raise ConfigError(f'{where} must be a number, not {shown!r}')
