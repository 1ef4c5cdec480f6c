"""One parameter of a node: name, type, default, bounds and description, without ROS."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

ParameterValue = (
    bool | int | float | str | Sequence[bool] | Sequence[int] | Sequence[float] | Sequence[str]
)


@dataclass(frozen=True)
class Parameter:
    """A node's parameter with all its documentation.

    Attributes
    ----------
    name
        Name, lower case with underscores.
    default
        Default value, which determines the type. For an empty list, also set `element`.
    description
        Meaning, in one sentence.
    unit
        SI unit, '' for none.
    minimum, maximum
        Smallest and largest allowed value; for a list, of every element.
    choices
        The allowed values of a string or integer.
    live
        Whether the value may change while the node runs.
    element
        Type of the elements of a list whose default is empty.
    group
        Heading in the help text; '' for the node's own parameters, which come first.
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
        """Name of the type in ROS, for example 'double' or 'string_array'."""
        if isinstance(self.default, (list, tuple)) and not self.default:
            return _kind([self.element()])
        return _kind(self.default)

    @property
    def is_list(self) -> bool:
        """Whether the value is a list."""
        return self.kind.endswith('_array')

    def heading(self) -> str:
        """Return name, type, unit, default, bounds and whether the value is live, in one line."""
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
        """Convert whole numbers to floating-point numbers for a floating-point parameter."""
        if self.kind == 'double' and _is_whole(value):
            return float(value)
        if self.kind == 'double_array' and isinstance(value, list):
            return [float(x) if _is_whole(x) else x for x in value]
        return value

    def problem(self, value: Any) -> str | None:
        """Return why a value is invalid and which values are valid, or None."""
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
        """Return the default in the form for `NAME:=`; '' if it is empty."""
        if isinstance(self.default, (list, tuple)):
            return f'[{", ".join(map(str, self.default))}]' if self.default else ''
        return str(self.default).lower() if isinstance(self.default, bool) else str(self.default)

    def constraints(self) -> str:
        """Return the bounds, and whether the value is read-only, for `ros2 param describe`."""
        when = (
            ''
            if self.live
            else ('this parameter is read-only: set it when the node starts, -p NAME:=VALUE')
        )
        return '; '.join(filter(None, (self._bounds(), when)))


# In this order, because a bool is an int in Python.
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
    """Return the name of a value's type in ROS, '' for other types and mixed lists."""
    if isinstance(value, (list, tuple)):
        kinds = {_kind(element) for element in value}
        return f'{kinds.pop()}_array' if len(kinds) == 1 else ''
    return next((name for kind, name in _TYPES.items() if isinstance(value, kind)), '')


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def grouped(group: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """Return parameters under a heading of the help, unless they already have another heading."""
    return tuple(item if item.group else replace(item, group=group) for item in parameters)


_SIM_TIME = 'use_sim_time'
_IGNORED = (
    f'{_SIM_TIME} is ignored, because this node uses the stamps of received messages, or '
    'the system clock'
)

LiveCallback = Callable[[str, Any], None]
Check = Callable[[dict[str, Any]], str]


class ParameterError(ValueError):
    """A parameter's start value is invalid."""


class ParameterTable:
    """The parameters of a node: declared, checked and kept up to date.

    An invalid value is rejected with the valid range, never clamped. Floating-point parameters
    accept whole numbers, so `-p rate:=100` equals `-p rate:=100.0`.

    Parameters
    ----------
    parameters
        The table.

    Raises
    ------
    ValueError
        If a name occurs twice or a default is out of its bounds.
    """

    def __init__(self, *parameters: Parameter) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}
        if len(self._parameters) != len(parameters):
            raise ValueError(f'a parameter is twice in the table: {[p.name for p in parameters]}')
        for parameter in parameters:
            problem = parameter.problem(parameter.default)
            if problem:
                raise ValueError(f'the default is not allowed: {problem}')

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._parameters.values())

    def declare(
        self, node: Node, on_change: LiveCallback | None = None, check: Check | None = None
    ) -> SimpleNamespace:
        """Declare the table on a node, and keep the node on the system clock.

        Parameters
        ----------
        node
            Node whose parameter overrides (command line, YAML) are applied.
        on_change
            Called with name and value after a live parameter was set, in the thread of the node's
            parameter services.
        check
            Called with the new values, by name, before live parameters are set together. Returns
            why they are invalid, or an empty text. Same thread.

        Returns
        -------
        SimpleNamespace
            One up-to-date attribute per parameter.

        Raises
        ------
        ParameterError
            If an override has the wrong type or value.
        """
        _use_system_clock(node)
        values = SimpleNamespace()
        for parameter in self._parameters.values():
            setattr(values, parameter.name, self._declare_one(node, parameter))

        def judge(changes: Sequence[RosParameter]) -> SetParametersResult:
            problems = [self._problem(change) for change in changes]
            reason = '; '.join(filter(None, problems))
            own = {c.name: _plain(c.value) for c in changes if c.name in self._parameters}
            if check is not None and own and not reason:
                reason = check(own)
            return SetParametersResult(successful=not reason, reason=reason)

        def store(changes: Sequence[RosParameter]) -> None:
            for change in changes:
                if change.name in self._parameters:
                    value = _plain(change.value)
                    setattr(values, change.name, value)
                    if on_change is not None:
                        on_change(change.name, value)

        node.add_pre_set_parameters_callback(self._adapt)
        node.add_on_set_parameters_callback(judge)
        node.add_post_set_parameters_callback(store)
        return values

    def _declare_one(self, node: Node, parameter: Parameter) -> Any:
        # An open type at first, so that the error message can show the user's value.
        open_type = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(parameter.name, _plain(parameter.default), open_type)
        # rcl reads the empty list of a parameter file as an unset parameter.
        is_empty_list = given.value is None and parameter.is_list
        value = [] if is_empty_list else parameter.adapt(_plain(given.value))
        problem = parameter.problem(value)
        if problem:
            raise ParameterError(problem)
        node.set_parameters([RosParameter(parameter.name, _ros_type(parameter), value)])
        node.set_descriptor(parameter.name, _descriptor(parameter))
        return value

    def _adapt(self, changes: Sequence[RosParameter]) -> list[RosParameter]:
        return [self._adapt_one(change) for change in changes]

    def _adapt_one(self, change: RosParameter) -> RosParameter:
        parameter = self._parameters.get(change.name)
        if parameter is None:
            return change
        value = parameter.adapt(_plain(change.value))
        if not parameter.has_type(value):
            return change  # rclpy reports the expected type
        return RosParameter(change.name, _ros_type(parameter), value)

    def _problem(self, change: RosParameter) -> str | None:
        if change.name == _SIM_TIME and change.value is True:
            return _IGNORED
        parameter = self._parameters.get(change.name)
        return parameter.problem(_plain(change.value)) if parameter else None


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the descriptor for `ros2 param describe`."""
    unit = f' [{parameter.unit}]' if parameter.unit else ''
    descriptor = ParameterDescriptor(
        name=parameter.name,
        type=_ros_type(parameter).value,
        description=f'{parameter.description}{unit}',
        additional_constraints=parameter.constraints(),
        read_only=not parameter.live,
    )
    if parameter.minimum is None and parameter.maximum is None:
        return descriptor
    # ROS has two-sided ranges only, so an open side becomes the largest number.
    if parameter.kind == 'double':
        low = -math.inf if parameter.minimum is None else float(parameter.minimum)
        high = math.inf if parameter.maximum is None else float(parameter.maximum)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif parameter.kind == 'integer':
        low = -(2**63) if parameter.minimum is None else int(parameter.minimum)
        high = 2**63 - 1 if parameter.maximum is None else int(parameter.maximum)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
    return descriptor


def _ros_type(parameter: Parameter) -> RosParameter.Type:
    return RosParameter.Type[parameter.kind.upper()]


def _use_system_clock(node: Node) -> None:
    """Switch simulated time off, because it would differ from the time of the states' stamps."""
    if node.get_parameter(_SIM_TIME).value:
        node.get_logger().warning(_IGNORED)
        node.set_parameters([RosParameter(_SIM_TIME, value=False)])


def _plain(value: Any) -> Any:
    """Convert tuples and rclpy's arrays to lists."""
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value
