"""Description of a node's parameter: name, type, default, bounds and meaning; imports no ROS."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

ParameterValue = (
    bool | int | float | str | Sequence[bool] | Sequence[int] | Sequence[float] | Sequence[str]
)


@dataclass(frozen=True)
class Parameter:
    """Description of a node's parameter, for help texts and for checks of values.

    Attributes
    ----------
    name
        Name, lower case with underscores.
    default
        Default value, which determines the type. If it is an empty list, also set `element`.
    description
        Meaning of the parameter, as a noun phrase.
    unit
        SI unit, '' for none.
    minimum, maximum
        Smallest and largest allowed value, for a list of each element.
    choices
        The allowed values of a string or integer.
    live
        Whether the value may change while the node runs.
    element
        Type of the elements, for a list with an empty default.
    group
        Heading in the help text. Parameters without a heading ('') come first.
    """

    name: str
    default: ParameterValue
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str | int, ...] = ()
    live: bool = False
    element: type = str
    group: str = ''

    @property
    def kind(self) -> str:
        """Name of the parameter's ROS type, for example 'double' or 'string_array'."""
        if isinstance(self.default, (list, tuple)) and not self.default:
            return _kind([self.element()])
        return _kind(self.default)

    @property
    def is_list(self) -> bool:
        """Whether the parameter's value is a list."""
        return self.kind.endswith('_array')

    def heading(self) -> str:
        """Return the first line of the help: name, type, unit, default and bounds."""
        kind = self.kind.replace('_array', ' list')
        default = self._default_text()
        details = (
            f'{kind} [{self.unit}]' if self.unit else kind,
            f'default {default}' if default else '',
            self._bounds(),
            'live' if self.live else '',
        )
        return f'{self.name} ({", ".join(filter(None, details))})'

    def adapt(self, value: Any) -> Any:
        """Return a value with integers converted to floats, if the parameter is of type double."""
        if self.kind == 'double' and _is_whole(value):
            return float(value)
        if self.kind == 'double_array' and isinstance(value, list):
            return [float(x) if _is_whole(x) else x for x in value]
        return value

    def problem(self, value: Any) -> str | None:
        """Return why a value is invalid, with the valid values; None for a valid value."""
        elements = value if isinstance(value, (list, tuple)) else (value,)
        if self.has_type(value) and all(self._is_allowed(element) for element in elements):
            return None
        return f'parameter {self.name} must be {self._wanted()}, not {value!r}'

    def has_type(self, value: Any) -> bool:
        """Return whether a value has the parameter's type."""
        if isinstance(value, (list, tuple)) and not value:
            return self.is_list
        return _kind(value) == self.kind

    def _is_allowed(self, value: Any) -> bool:
        if self.choices and value not in self.choices:
            return False
        if isinstance(value, str):
            return True
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        return bool(math.isfinite(value) and low <= value <= high)

    def _wanted(self) -> str:
        kind = _KINDS[self.kind]
        unit = f' in {self.unit}' if self.unit else ''
        bounds = self._bounds()
        return f'{kind}{unit}' + (f', {bounds}' if bounds else '')

    def _bounds(self) -> str:
        if self.choices:
            return 'one of ' + ', '.join(map(str, self.choices))
        if self.minimum is not None and self.maximum is not None:
            return f'from {self.minimum} to {self.maximum}'
        if self.minimum is not None:
            return f'at least {self.minimum}'
        return '' if self.maximum is None else f'at most {self.maximum}'

    def _default_text(self) -> str:
        """Return the default as written on the command line, '' for an empty default."""
        if isinstance(self.default, (list, tuple)):
            return f'[{", ".join(map(str, self.default))}]' if self.default else ''
        return str(self.default).lower() if isinstance(self.default, bool) else str(self.default)

    def constraints(self) -> str:
        """Return a text for `ros2 param describe`: the bounds, and whether it is read-only."""
        fixed = 'read-only while the node runs: set the value at the start with -p NAME:=VALUE'
        return '; '.join(filter(None, (self._bounds(), '' if self.live else fixed)))


# bool comes before int, because a bool is an int in Python.
_TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}
_KINDS = {
    'bool': 'true or false',
    'integer': 'a whole number',
    'double': 'a finite number',
    'string': 'a string',
    'bool_array': 'a list of true or false',
    'integer_array': 'a list of whole numbers',
    'double_array': 'a list of finite numbers',
    'string_array': 'a list of strings',
}


def _kind(value: Any) -> str:
    """Return the ROS type name of a value, '' for a type that ROS parameters cannot have."""
    if isinstance(value, (list, tuple)):
        kinds = {_kind(element) for element in value}
        return f'{kinds.pop()}_array' if len(kinds) == 1 else ''
    return next((name for kind, name in _TYPES.items() if isinstance(value, kind)), '')


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def grouped(group: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """Return the parameters with the heading `group`, unless a parameter has another heading."""
    return tuple(item if item.group else replace(item, group=group) for item in parameters)
