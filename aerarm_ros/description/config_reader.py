"""From a YAML mapping to a frozen dataclass, with errors that name the key."""

import dataclasses
import math
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from aerarm_ros.description.config_error import ConfigError
from aerarm_ros.description.plain_yaml import read_plain
from aerarm_ros.description.resources import find_file, resource

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
        raise ConfigError(f'{path}: {reason}: check the path and its permissions') from None
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None
    if not isinstance(document, dict):
        raise ConfigError(f'{path}: must hold a mapping of keys, see the packaged example')
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
        raise ConfigError(f'{key} must be a {name} that is not empty')
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
            f'{where}: unknown key {", ".join(unknown)}: the keys are {", ".join(known)}'
        )
    missing = [key for key in required if key not in entry]
    if missing:
        raise ConfigError(f'{where}: key {", ".join(missing)} is missing')


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
        raise ConfigError(f'{where}: key {", ".join(repeated)} is given by its place, leave it out')
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
