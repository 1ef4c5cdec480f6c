"""Set a live parameter of another node from command-line text."""

from __future__ import annotations

import time
from collections.abc import Callable
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


def set_parameter(node: Node, target: str, name: str, text: str, timeout: float) -> Any:
    """Set a parameter of the node `target` and return its new value.

    Parameters
    ----------
    node
        Client node; no executor may contain it.
    target, name
        Relative or absolute node name, and parameter name.
    text
        Value in YAML; for a string parameter the string itself.
    timeout
        Longest time to find the node, and again for each answer [s].

    Raises
    ------
    ArmClientError
        If node or parameter does not exist, or the node does not answer, or refuses.
    """
    client = AsyncParameterClient(node, target)
    if not spin_until(node, client.services_are_ready, timeout):
        raise ArmClientError(
            f'node {target} was not found, or has no parameters: check that it runs in '
            f'{this_domain()}'
        )

    def result(ask: Callable[[], Future]) -> Any:
        # An answer is lost if the node has not yet discovered the client.
        futures: list[Future] = []
        deadline = time.monotonic() + timeout
        while not any(future.done() for future in futures):
            left = deadline - time.monotonic()
            if left < 0.0:
                raise ArmClientError(
                    f'{target} did not respond within {timeout:g} s: check that it runs'
                )
            futures.append(ask())
            spin_until(node, lambda: any(f.done() for f in futures), min(ASK_AGAIN, left))
        return next(future.result() for future in futures if future.done())

    descriptors = result(lambda: client.describe_parameters([name])).descriptors
    if not descriptors:
        known = result(client.list_parameters).result.names
        closest = next(iter(get_close_matches(name, known, n=1)), '')
        hint = f", did you mean '{closest}'?" if closest else ''
        raise ArmClientError(f"{target} has no parameter '{name}'{hint}")
    if descriptors[0].read_only:
        raise ArmClientError(
            f'parameter {name} of {target} is read-only: set it when the node starts, -p '
            f'{name}:={text}'
        )
    parameter = Parameter(name, value=_value(descriptors[0], text))
    answer = result(lambda: client.set_parameters([parameter])).results[0]
    if not answer.successful:
        raise ArmClientError(f'{target} rejects the value: {answer.reason}')
    return parameter.value


def _value(descriptor: ParameterDescriptor, text: str) -> Any:
    """Convert text to a value of the parameter's type."""
    if descriptor.type == _Type.STRING.value:
        return text
    try:
        value = plain_data(text)
    except ConfigError:
        value = None
    if descriptor.type == _Type.DOUBLE.value:
        value = _number(value)
    elif descriptor.type == _Type.DOUBLE_ARRAY.value and value is not None:
        elements = value if isinstance(value, list) else [value]
        value = [_number(element) for element in elements]
    try:
        _Type.from_parameter_value(value)
    except TypeError:
        value = None
    if value is None:
        raise ArmClientError(f'{text!r} is not a valid value: use 0.5, true or [1.0, 2.0]')
    return value


def _number(value: Any) -> Any:
    """Convert a YAML value to a floating-point number, such as 2 or 1e-3 (a text in YAML)."""
    if isinstance(value, bool):
        return value
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return value
