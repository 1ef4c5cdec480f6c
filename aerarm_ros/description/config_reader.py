"""Reader of YAML files, with conversion to dataclasses; errors name the faulty key."""

import dataclasses
import math
import re
import types
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from aerarm_ros.description.resources import find_file, resource


class DescriptionError(ValueError):
    """Error for an unusable URDF; the message names the joint or link and the remedy."""


class ConfigError(ValueError):
    """Error for an unusable configuration; the message names the key and its allowed values."""


def ranged(low: float, high: float, unit: str = '', **given: Any) -> Any:
    """Return a dataclass field of one or more numbers from `low` to `high`, see `check_fields`.

    Ranges are wide enough for any real arm: the check detects NaN and wrong units. `given` are
    arguments of `dataclasses.field`, for example a default.
    """
    return dataclasses.field(metadata={'range': (low, high, unit)}, **given)


def vector(bound: float, unit: str, **given: Any) -> Any:
    """Return a dataclass field of three numbers from -`bound` to `bound`, see `check_fields`."""
    return dataclasses.field(metadata={'range': (-bound, bound, unit), 'length': 3}, **given)


def one_of(*choices: object, **given: Any) -> Any:
    """Return a dataclass field whose value is one of `choices`, see `check_fields`."""
    return dataclasses.field(metadata={'choices': choices}, **given)


def check_fields(owner: str, config: Any) -> None:
    """Check the fields of a dataclass: ranges, choices, and texts without default not empty.

    An optional field may be None. `owner` names the part of the configuration in messages.

    Raises
    ------
    ConfigError
        If a value is invalid; the message names the key and the allowed values.
    """
    for field in dataclasses.fields(config):
        value, rule = getattr(config, field.name), field.metadata
        is_name = field.type in (str, 'str') and field.default is dataclasses.MISSING
        if is_name and not (isinstance(value, str) and value.strip()):
            raise ConfigError(f'{owner}: {field.name} = {value!r} must be a name')
        if 'length' in rule and len(value) != rule['length']:
            raise ConfigError(f'{owner}: {field.name} = {list(value)} must be a list of x, y and z')
        if 'choices' in rule:
            check_choice(owner, field.name, value, rule['choices'])
        if 'range' in rule and value is not None:
            for number in value if isinstance(value, tuple) else (value,):
                check_range(owner, field.name, number, *rule['range'])


def check_choice(owner: str, key: str, value: object, choices: tuple[object, ...]) -> None:
    """Raise ConfigError if a value is not one of `choices`; the message lists them."""
    if isinstance(value, bool) or value not in choices:
        listed = ', '.join(map(str, choices))
        raise ConfigError(f'{owner}: {key} = {value!r} must be one of {listed}')


def check_unique(owner: str, key: str, values: Sequence[object]) -> None:
    """Raise ConfigError if a value occurs twice."""
    for value in values:
        if values.count(value) > 1:
            raise ConfigError(f'{owner}: {key} {value!r} occurs twice; rename or remove one')


def check_range(owner: str, key: str, value: float, low: float, high: float, unit: str) -> None:
    """Check that `low <= value <= high`.

    Raises
    ------
    ConfigError
        If the value is outside the range, not finite, or not a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{owner}: {key} must be a number, not {value!r}')
    if not (math.isfinite(value) and low <= value <= high):
        unit_text = f' [{unit}]' if unit else ''
        raise ConfigError(
            f'{owner}: {key} = {value} must lie in {low:g} .. {high:g}{unit_text}; check the '
            'number and its unit'
        )


LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""YAML loader for plain data: PyYAML's C loader if available, which is ten times faster."""

_LARGEST = 2**20  # bytes; ten times the largest file of this package
_DEEPEST = 20
_LONGEST_NUMBER = 64  # characters
_NUMBER = re.compile(r'[-+]?[0-9][0-9a-fA-FxXob_:.+-]*')
_OPENING = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_CLOSING = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


class UniqueKeyLoader(LOADER):  # type: ignore[misc]
    """YAML loader for plain data that rejects repeated keys, which PyYAML would accept."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping from a YAML node; raise ConfigError for a repeated key."""
        seen = set()
        for key_node, _ in node.value:
            key = getattr(key_node, 'value', None)
            if isinstance(key, str) and key in seen:
                line = key_node.start_mark.line + 1
                raise ConfigError(f'line {line}: key {key[:100]} is given twice: remove one')
            seen.add(key if isinstance(key, str) else id(key_node))
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found


def read_plain(path: Path, loader: Any = UniqueKeyLoader) -> Any:
    """Read a YAML file as plain data; see `plain_data` for the conditions.

    Raises
    ------
    OSError
        If the file cannot be read.
    ConfigError
        If the file is too large or not plain YAML.
    """
    with path.open('rb') as stream:
        content = stream.read(_LARGEST + 1)
    try:
        return plain_data(content.decode(), loader)
    except UnicodeDecodeError as error:
        raise ConfigError(f'not valid YAML: {error}') from None


def plain_data(text: str, loader: Any = UniqueKeyLoader) -> Any:
    """Parse a YAML text into plain data.

    Parameters
    ----------
    loader : type
        `LOADER` or a subclass.

    Raises
    ------
    ConfigError
        If the text is not YAML, repeats a key, or contains anchors or aliases (which can expand a
        small text without limit). Also if the text, its nesting or one of its numbers is longer
        than in any configuration.
    """
    if len(text) > _LARGEST:
        raise ConfigError(
            f'the file is larger than {_LARGEST} bytes, the limit for a configuration'
        )
    try:
        _check_events(text)
        return yaml.load(text, Loader=loader)
    except ConfigError:
        raise
    except yaml.YAMLError as error:
        # libyaml reaches its own limit before `_check_events` sees the nesting.
        if 'nesting depth' in str(error):
            raise ConfigError(f'the YAML is nested more than {_DEEPEST} levels deep') from None
        raise ConfigError(f'not valid YAML: {" ".join(str(error).split())}') from None
    except (ValueError, TypeError, AttributeError, LookupError, OverflowError) as error:
        # A value that contradicts its form or tag, for example 2001-99-99.
        raise ConfigError(f'not valid YAML: {" ".join(str(error).split())}') from None


def _check_events(text: str) -> None:
    """Reject a YAML text with anchors, deep nesting or long numbers before it is parsed."""
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        reason = ''
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None):
            reason = 'YAML anchors and aliases are not supported: write each value in its place'
        depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
        if depth > _DEEPEST:
            reason = f'the YAML is nested more than {_DEEPEST} levels deep'
        if isinstance(event, yaml.ScalarEvent) and _is_long_number(event):
            length = len(event.value)
            reason = f'the number has {length} characters, above the limit of {_LONGEST_NUMBER}'
        if reason:
            line = event.start_mark.line + 1 if event.start_mark else 0
            raise ConfigError(f'line {line}: {reason}')


def _is_long_number(event: Any) -> bool:
    """Return whether a YAML value is parsed as a number, and has too many digits."""
    long = len(event.value) > _LONGEST_NUMBER
    return long and (event.tag is not None or _NUMBER.fullmatch(event.value) is not None)


_LONGEST = 64  # characters
_PREFIX = re.compile(r'([A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*/?)?')


def check_prefix(prefix: str) -> None:
    """Check that link and joint names with this prefix are valid names of ROS frames.

    Raises
    ------
    DescriptionError
        If the prefix contains other characters than letters, digits, underscores and single
        slashes, does not begin with a letter, or is very long. An empty prefix is valid.
    """
    if len(prefix) > _LONGEST or not _PREFIX.fullmatch(prefix):
        raise DescriptionError(
            f'tf_prefix {prefix[:_LONGEST]!r} must begin with a letter and contain only letters, '
            'digits, _ and single /, for example left_'
        )


Config = TypeVar('Config')

_FRACTION = re.compile(r'([-+]?\d{1,15})/(\d{1,15})')
_LONGEST_SHOWN = 100  # characters of an invalid value that a message shows


def yaml_text(document: dict[str, Any]) -> str:
    """Return a mapping as YAML text, with lists of numbers in single lines."""
    text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
    return text


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that contains one mapping.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not plain YAML, repeats a key or is not a mapping.
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
            f'{path}: the file must contain a mapping of keys: compare it with the packaged '
            'example in config/'
        )
    return document


def config_path(path: Path | str | None, packaged: str) -> Path:
    """Return the path of a configuration file; if None, that of the packaged file in config/."""
    return resource('config', packaged) if path is None else find_file(path)


def load(
    path: Path | str | None, packaged: str, make: Callable[[dict[str, Any]], Config]
) -> Config:
    """Read a YAML file, and convert its content with `make`; if None, the packaged file.

    Raises
    ------
    ConfigError
        If the file cannot be read or is invalid; the one-line message names file and key.
    """
    source = config_path(path, packaged)
    document = read_yaml(source)
    try:
        return make(document)
    except ConfigError as error:
        raise ConfigError(f'{source}: {error}') from None


def section(document: dict[str, Any], key: str, kind: type) -> Any:
    """Return the non-empty list or mapping `document[key]` of type `kind`, or raise ConfigError."""
    value = document[key]
    if not isinstance(value, kind) or not value:
        name = 'mapping' if kind is dict else 'list'
        raise ConfigError(f'{key} must be a non-empty {name}')
    return value


def check_keys(where: str, entry: Any, config: type, also: tuple[str, ...] = ()) -> None:
    """Check that `entry` is a mapping with exactly the fields of `config` and `also`.

    Raises
    ------
    ConfigError
        If the entry is not a mapping, or a key is missing or unknown.
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
    """Build the dataclass `config` from a mapping that was read from YAML.

    Parameters
    ----------
    config : type
        Dataclass with fields of type float, int, bool, str, optional float or tuple of floats;
        fields of other types must be in `given`.
    where : str
        Location in the file, for messages.
    entry : mapping
        One key per field; fields with a default are optional.
    **given
        Values of fields that are not in `entry`, for example the key of the entry.

    Raises
    ------
    ConfigError
        If a key is unknown or missing, its value has the wrong type, or the dataclass rejects it.
    """
    if not isinstance(entry, dict):
        raise ConfigError(f'{where} must be a mapping of keys, not {entry!r}')
    repeated = [key for key in given if key in entry]
    if repeated:
        raise ConfigError(
            f'{where}: the key {", ".join(repeated)} follows from the position of the entry in '
            'the file: delete it'
        )
    values = {**entry, **given}
    check_keys(where, values, config)
    hints = get_type_hints(config)
    converted = {
        key: _convert(f'{where}: {key}', value, hints[key]) for key, value in values.items()
    }
    return config(**converted)


_PLAIN = {bool: 'true or false', int: 'a whole number'}


def _convert(where: str, value: Any, hint: Any) -> Any:
    if isinstance(hint, types.UnionType):
        inner = [option for option in get_args(hint) if option is not types.NoneType]
        return None if value is None else _convert(where, value, inner[0])
    if hint is float:
        return _number(where, value)
    if hint in _PLAIN and type(value) is not hint:
        raise ConfigError(f'{where} must be {_PLAIN[hint]}, not {value!r}')
    if get_origin(hint) is tuple and get_args(hint)[0] is float:
        if not isinstance(value, list | tuple):
            raise ConfigError(f'{where} must be a list of numbers, not {value!r}')
        return tuple(_number(where, item) for item in value)
    return value


def _number(where: str, value: Any) -> float:
    """Return a float; accept '1/31' and '1e-5', which YAML 1.1 reads as texts."""
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
