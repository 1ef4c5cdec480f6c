"""One parameter of a node, as its table describes it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter as RosParameter

ParameterValue = (
    bool | int | float | str | Sequence[bool] | Sequence[int] | Sequence[float] | Sequence[str]
)


@dataclass(frozen=True)
class Parameter:
    """A parameter with everything a user may ask about it.

    Attributes
    ----------
    name
        Name, lower case with underscores.
    default
        Value when the user gives none; its type is the parameter's type. An empty list
        has no type: give `element`.
    description
        What it does, in one sentence.
    unit
        SI unit, '' for none.
    minimum, maximum
        Bounds, both allowed values; for a list, bounds of every element.
    choices
        The only values allowed, for strings and integers.
    live
        Whether it may change while the node runs.
    element
        Type of the elements of a list whose default is empty.
    group
        Heading under which help lists it; the node's own, which come first, have none.
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
    def type(self) -> RosParameter.Type:
        """Type as ROS names it."""
        if isinstance(self.default, (list, tuple)) and not self.default:
            return RosParameter.Type.from_parameter_value([self.element()])
        return RosParameter.Type.from_parameter_value(self.default)

    @property
    def is_list(self) -> bool:
        """Whether its value is a list."""
        return bool(self.type.name.endswith('_ARRAY'))

    def descriptor(self) -> ParameterDescriptor:
        """Return what `ros2 param describe` shows."""
        unit = f' [{self.unit}]' if self.unit else ''
        descriptor = ParameterDescriptor(
            name=self.name,
            type=self.type.value,
            description=f'{self.description}{unit}',
            additional_constraints=self._constraints(),
            read_only=not self.live,
        )
        if self.minimum is None and self.maximum is None:
            return descriptor
        # ROS knows two-sided ranges only; an open side becomes the largest number there is.
        if self.type is RosParameter.Type.DOUBLE:
            low = -math.inf if self.minimum is None else float(self.minimum)
            high = math.inf if self.maximum is None else float(self.maximum)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.type is RosParameter.Type.INTEGER:
            low = -(2**63) if self.minimum is None else int(self.minimum)
            high = 2**63 - 1 if self.maximum is None else int(self.maximum)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
        return descriptor

    def heading(self) -> str:
        """Return name, type, unit, default, bounds and whether it is live, in one line."""
        kind = self.type.name.lower().replace('_array', ' list')
        default = self._default_text()
        details = (
            f'{kind} [{self.unit}]' if self.unit else kind,
            f'default {default}' if default else '',
            self._bounds(),
            'live' if self.live else '',
        )
        return f'{self.name} ({", ".join(filter(None, details))})'

    def adapt(self, value: Any) -> Any:
        """Return whole numbers as floating-point ones where the parameter is such."""
        if self.type is RosParameter.Type.DOUBLE and _is_whole(value):
            return float(value)
        if self.type is RosParameter.Type.DOUBLE_ARRAY and isinstance(value, list):
            return [float(x) if _is_whole(x) else x for x in value]
        return value

    def problem(self, value: Any) -> str | None:
        """Say what is wrong with a value and what would be right, or return None."""
        elements = value if isinstance(value, (list, tuple)) else (value,)
        if self.has_type(value) and all(self._is_allowed(element) for element in elements):
            return None
        return f'parameter {self.name} must be {self._wanted()}, not {value!r}'

    def has_type(self, value: Any) -> bool:
        """Tell whether a value has the parameter's type."""
        if isinstance(value, (list, tuple)) and not value:
            return self.is_list
        try:
            return bool(RosParameter.Type.from_parameter_value(value) is self.type)
        except TypeError:
            return False

    def _is_allowed(self, value: Any) -> bool:
        if self.choices and value not in self.choices:
            return False
        if isinstance(value, str):
            return True
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        return bool(math.isfinite(value) and low <= value <= high)

    def _wanted(self) -> str:
        kind = _KINDS[self.type]
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
        """Return the default as it is typed after `NAME:=`, '' if it is empty."""
        if isinstance(self.default, (list, tuple)):
            return f'[{", ".join(map(str, self.default))}]' if self.default else ''
        return str(self.default).lower() if isinstance(self.default, bool) else str(self.default)

    def _constraints(self) -> str:
        when = '' if self.live else 'read once: give it when the node starts, -p NAME:=VALUE'
        return '; '.join(filter(None, (self._bounds(), when)))


_KINDS = {
    RosParameter.Type.BOOL: 'true or false',
    RosParameter.Type.INTEGER: 'a whole number',
    RosParameter.Type.DOUBLE: 'a finite number',
    RosParameter.Type.STRING: 'a string',
    RosParameter.Type.BOOL_ARRAY: 'a list of true or false',
    RosParameter.Type.INTEGER_ARRAY: 'a list of whole numbers',
    RosParameter.Type.DOUBLE_ARRAY: 'a list of finite numbers',
    RosParameter.Type.STRING_ARRAY: 'a list of strings',
}


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def grouped(group: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """Return parameters under a heading of the help, those that have one already under theirs."""
    return tuple(item if item.group else replace(item, group=group) for item in parameters)
