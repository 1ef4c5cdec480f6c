"""The output of `ros2 param dump` is a valid parameter file of the node."""

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from own_domain import own_domain
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from test_parameter_bounds import nodes

from aerarm_ros.executables import command_modules
from aerarm_ros.ros.parameters.parameter_table import ParameterError, ParameterTable
from aerarm_ros.ros.process.node_main import CommandLine
from aerarm_ros.ros.process.node_process import ros_environment
from aerarm_ros.ros.process.ros_arguments import RosArguments


@pytest.fixture(scope='module')
def ros() -> Iterator[None]:
    """Let all these nodes share one context, in a domain of their own."""
    with pytest.MonkeyPatch.context() as patch:
        for variable, value in ros_environment(own_domain()).items():
            patch.setenv(variable, value)
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def dump(node: Node) -> dict:
    """Return what `ros2 param dump` writes: groups where names have dots, as YAML keeps them."""
    names = sorted(node.list_parameters([], 0).names)
    content: dict = {}
    for name, parameter in zip(names, node.get_parameters(names), strict=True):
        *groups, last = name.split('.')
        below = content
        for group in groups:
            below = below.setdefault(group, {})
        below[last] = parameter_value_to_python(parameter.get_parameter_value())
    return {node.get_fully_qualified_name(): {'ros__parameters': content}}


def declared(name: str, table: ParameterTable, *arguments: str) -> tuple[dict, dict]:
    """Return the values of a node's parameters, and their dump."""
    node = Node(name, cli_args=list(arguments) or None, start_parameter_services=False)
    try:
        return vars(table.declare(node)), dump(node)
    finally:
        node.destroy_node()


def test_a_dump_loads_again(tmp_path: Path, ros: None) -> None:
    for name in nodes():
        table = importlib.import_module(command_modules()[name]).PARAMETERS
        values, content = declared(name, table)
        path = tmp_path / f'{name}.yaml'
        path.write_text(yaml.dump(content, default_flow_style=False))
        arguments = ['--ros-args', '--params-file', str(path)]
        assert CommandLine(name, table, '').check(RosArguments(arguments)) == [], name
        assert declared(name, table, *arguments) == (values, content), name


def test_only_a_list_may_be_empty(tmp_path: Path, ros: None) -> None:
    table = importlib.import_module('aerarm_ros.nodes.controllers.computed_torque').PARAMETERS
    path = tmp_path / 'd.yaml'
    path.write_text('/computed_torque: {ros__parameters: {goal_time: []}}')
    with pytest.raises(ParameterError, match='goal_time must be a finite number'):
        declared('computed_torque', table, '--ros-args', '--params-file', str(path))
