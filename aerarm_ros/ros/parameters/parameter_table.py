"""Parameters of a node, declared in one table."""

from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from aerarm_ros.ros.parameters.parameter import Parameter

_SIM_TIME = 'use_sim_time'
_IGNORED = (
    f'{_SIM_TIME} is ignored: this node goes by the stamps of what it hears, '
    'and else by the system clock'
)

LiveCallback = Callable[[str, Any], None]
Check = Callable[[dict[str, Any]], str]


class ParameterError(ValueError):
    """A parameter given at the start that the node can't run with."""


class ParameterTable:
    """The parameters of a node: declared, checked, and kept up to date.

    A bad value is rejected with what would be right, never clamped. Whole numbers are taken
    for floating-point parameters, so `-p rate:=100` works as `-p rate:=100.0`.

    Parameters
    ----------
    parameters
        The table.

    Raises
    ------
    ValueError
        If a name occurs twice or a default breaks its own bounds.
    """

    def __init__(self, *parameters: Parameter) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}
        if len(self._parameters) != len(parameters):
            raise ValueError(f'a parameter is in the table twice: {[p.name for p in parameters]}')
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
            Its parameter overrides (command line, YAML) count.
        on_change
            Called with name and value after a live parameter was set. It runs in the
            thread that serves the node's parameter services.
        check
            Called before live parameters are stored with the new values that are set
            together, by name; returns why they can't be taken, or ''. Same thread.

        Returns
        -------
        SimpleNamespace
            One attribute a parameter, kept up to date.

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
        # Declared with an open type first, to see what the user gave and say what is wrong.
        open_type = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(parameter.name, _plain(parameter.default), open_type)
        # rcl reads the empty list of a parameter file as a parameter that is not set.
        is_empty_list = given.value is None and parameter.is_list
        value = [] if is_empty_list else parameter.adapt(_plain(given.value))
        problem = parameter.problem(value)
        if problem:
            raise ParameterError(problem)
        node.set_parameters([RosParameter(parameter.name, parameter.type, value)])
        node.set_descriptor(parameter.name, parameter.descriptor())
        return value

    def _adapt(self, changes: Sequence[RosParameter]) -> list[RosParameter]:
        return [self._adapt_one(change) for change in changes]

    def _adapt_one(self, change: RosParameter) -> RosParameter:
        parameter = self._parameters.get(change.name)
        if parameter is None:
            return change
        value = parameter.adapt(_plain(change.value))
        if not parameter.has_type(value):
            return change  # rclpy says which type it expects
        return RosParameter(change.name, parameter.type, value)

    def _problem(self, change: RosParameter) -> str | None:
        if change.name == _SIM_TIME and change.value is True:
            return _IGNORED
        parameter = self._parameters.get(change.name)
        return parameter.problem(_plain(change.value)) if parameter else None


def _use_system_clock(node: Node) -> None:
    """Switch simulated time off, which would be another time than that of the states' stamps."""
    if node.get_parameter(_SIM_TIME).value:
        node.get_logger().warning(_IGNORED)
        node.set_parameters([RosParameter(_SIM_TIME, value=False)])


def _plain(value: Any) -> Any:
    """Return tuples and rclpy's arrays as lists."""
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value
