"""Declare and check the parameters of a node."""

import math
from collections.abc import Callable, Iterator, Sequence
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

from aerarm_ros.ros.parameters.parameter import Parameter

_SIM_TIME = 'use_sim_time'
_IGNORED = (
    f'{_SIM_TIME} has no effect, because this node uses the stamps of received messages or the '
    'system clock as time: remove this setting'
)

LiveCallback = Callable[[str, Any], None]
Check = Callable[[dict[str, Any]], str]


class ParameterError(ValueError):
    """A parameter has an invalid value at the start of a node."""


class ParameterTable:
    """Table that declares and checks all parameters of a node.

    The node rejects an invalid value and states the valid range; it never clamps a value.
    Floating-point parameters accept whole numbers, so `-p rate:=100` equals `-p rate:=100.0`.

    Parameters
    ----------
    parameters
        All parameters of the node.

    Raises
    ------
    ValueError
        If a name occurs twice or a default is out of its bounds.
    """

    def __init__(self, *parameters: Parameter) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}
        if len(self._parameters) != len(parameters):
            names = [parameter.name for parameter in parameters]
            raise ValueError(f'two of these parameters have the same name: {names}')
        for parameter in parameters:
            problem = parameter.problem(parameter.default)
            if problem:
                raise ValueError(f'the default value is invalid: {problem}')

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._parameters.values())

    def declare(
        self, node: Node, on_change: LiveCallback | None = None, check: Check | None = None
    ) -> SimpleNamespace:
        """Declare the parameters on a node, and make the node use the system clock.

        Parameters
        ----------
        node
            Node whose parameter overrides (command line, YAML) are applied.
        on_change
            Called with name and value after a live parameter was set, in the thread that serves the
            node's parameters.
        check
            Called in the same thread with the new values by name, before live parameters are set.
            Returns why the values are invalid, or an empty string.

        Returns
        -------
        SimpleNamespace
            Present value of each parameter, as attribute with the parameter's name.

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

        node.add_pre_set_parameters_callback(lambda changes: [self._adapt(c) for c in changes])
        node.add_on_set_parameters_callback(judge)
        node.add_post_set_parameters_callback(store)
        return values

    def _declare_one(self, node: Node, parameter: Parameter) -> Any:
        # The type is dynamic at first, so that the error message can contain the user's value.
        open_type = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(parameter.name, _plain(parameter.default), open_type)
        # rcl represents an empty list in a parameter file as an unset parameter.
        is_empty_list = given.value is None and parameter.is_list
        value = [] if is_empty_list else parameter.adapt(_plain(given.value))
        problem = parameter.problem(value)
        if problem:
            raise ParameterError(problem)
        node.set_parameters([RosParameter(parameter.name, _ros_type(parameter), value)])
        node.set_descriptor(parameter.name, _descriptor(parameter))
        return value

    def _adapt(self, change: RosParameter) -> RosParameter:
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
    """Return the ROS descriptor of a parameter, which `ros2 param describe` prints."""
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
    # A ROS range needs both bounds, so a missing bound becomes the largest number.
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
    """Switch `use_sim_time` off, because the node takes the time from stamps of messages."""
    if node.get_parameter(_SIM_TIME).value:
        node.get_logger().warning(_IGNORED)
        node.set_parameters([RosParameter(_SIM_TIME, value=False)])


def _plain(value: Any) -> Any:
    """Convert tuples and arrays to lists, and leave other values unchanged."""
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value
