"""Client that reads and sets the parameters of another node while the node runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from aerarm_ros.description.config_reader import ConfigError, plain_data
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.bridge_service import ASK_AGAIN

_Type = Parameter.Type


class ParameterRequest:
    """Read and set the parameters of another node.

    Parameters
    ----------
    node
        Client node; no executor may contain it.
    target
        Relative or absolute node name.
    timeout
        Longest time to find the node, and again for each answer [s].

    Raises
    ------
    ArmClientError
        If the node is not found. The methods also raise this error if the node does not answer.
    """

    def __init__(self, node: Node, target: str, timeout: float) -> None:
        self._node, self._target, self._timeout = node, target, timeout
        self._client = AsyncParameterClient(node, target)
        if not spin_until(node, self._client.services_are_ready, timeout):
            raise ArmClientError(
                f'node {target} was not found or has no parameters: check its name, and that it '
                f'runs in {this_domain()}'
            )

    def set(self, name: str, text: str) -> Any:
        """Set a parameter to a value written in YAML, and return the value.

        A string parameter is set to `text` without parsing. The method raises ArmClientError if
        the parameter does not exist or the node rejects the value.
        """
        client, target = self._client, self._target
        descriptors = self._result(lambda: client.describe_parameters([name])).descriptors
        if not descriptors:
            known = self._result(client.list_parameters).result.names
            closest = next(iter(get_close_matches(name, known, n=1)), '')
            hint = f", did you mean '{closest}'?" if closest else ''
            raise ArmClientError(f"the node {target} has no parameter '{name}'{hint}")
        if descriptors[0].read_only:
            raise ArmClientError(
                f'parameter {name} of {target} is read-only: restart the node with -p '
                f'{name}:={text}'
            )
        parameter = Parameter(name, value=_value(descriptors[0], text))
        answer = self._result(lambda: client.set_parameters([parameter])).results[0]
        if not answer.successful:
            raise ArmClientError(f'the node {target} rejects the value: {answer.reason}')
        return parameter.value

    @contextmanager
    def during(self, name: str, text: str) -> Iterator[None]:
        """Set a string parameter while a `with` block runs, then restore its former value."""
        former = self._result(lambda: self._client.get_parameters([name])).values
        self.set(name, text)
        try:
            yield
        finally:
            self.set(name, former[0].string_value)

    def _result(self, ask: Callable[[], Future]) -> Any:
        # An answer is lost if the node has not yet discovered the client.
        futures: list[Future] = []
        deadline = time.monotonic() + self._timeout
        while not any(future.done() for future in futures):
            left = deadline - time.monotonic()
            if left < 0.0:
                raise ArmClientError(
                    f'the node {self._target} did not respond within {self._timeout:g} s: check '
                    'that the node runs'
                )
            futures.append(ask())
            spin_until(self._node, lambda: any(f.done() for f in futures), min(ASK_AGAIN, left))
        return next(future.result() for future in futures if future.done())


def _value(descriptor: ParameterDescriptor, text: str) -> Any:
    """Convert command-line text to a value of the parameter's type."""
    kind = _Type(descriptor.type)
    if kind == _Type.STRING:
        return text
    try:
        value = plain_data(text)
        if kind == _Type.DOUBLE:
            value = _number(value)
        elif kind == _Type.DOUBLE_ARRAY:
            value = [
                _number(element) for element in (value if isinstance(value, list) else [value])
            ]
        if value is not None and _Type.from_parameter_value(value):
            return value
    except (ConfigError, TypeError, ValueError, OverflowError):
        pass
    raise ArmClientError(
        f'{text!r} is not a valid value of the parameter: write a value such as 0.5, true or '
        '[1.0, 2.0]'
    )


def _number(value: Any) -> Any:
    """Convert an integer, or a text such as '1e-3', to float; return a bool unchanged."""
    return value if isinstance(value, bool) else float(value)
