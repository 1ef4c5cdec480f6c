"""Parameter tables on real nodes: command-line overrides, and sets while running."""

import math
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterError, ParameterTable

TABLE = ParameterTable(
    Parameter('rate', 100.0, 'cycles', 'Hz', 1, 2000, live=True),
    Parameter('gains', (), 'stiffness of each joint', 'Nm/rad', 0, live=True, element=float),
    Parameter('count', 3, 'how often', minimum=1, live=True),
    Parameter('mode', 'hold', 'what to do', choices=('hold', 'move'), live=True),
    Parameter('enabled', False, 'whether to do it', live=True),
    Parameter('topics', ('a', 'b'), 'what to listen to'),
)


@pytest.fixture
def declare(ros_domain):
    """Return a function that declares the table on a node with overrides."""
    rclpy.init(args=[])
    nodes: list[Node] = []

    def declare(*overrides: str, on_change=None, file='') -> tuple[Node, SimpleNamespace]:
        arguments = ['--ros-args', *(part for text in overrides for part in ('-p', text))]
        arguments += ['--params-file', str(file)] if file else []
        nodes.append(Node('test', cli_args=arguments if arguments[1:] else None))
        return nodes[-1], TABLE.declare(nodes[-1], on_change)

    yield declare
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def set_parameter(node: Node, name: str, value: object) -> str:
    """Return why a value was rejected, '' if it wasn't."""
    (result,) = node.set_parameters([RosParameter(name, value=value)])
    assert result.successful == (result.reason == '')
    return result.reason


def test_defaults_and_overrides(declare) -> None:
    _, values = declare('rate:=50', 'gains:=[1, 2]', 'mode:=move', "topics:=['x']")
    assert values.rate == 50.0
    assert isinstance(values.rate, float)
    assert values.gains == [1.0, 2.0]
    assert (values.mode, values.topics, values.count, values.enabled) == ('move', ['x'], 3, False)


def test_only_a_list_may_be_empty_in_a_file(declare, tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text('/test: {ros__parameters: {gains: [], topics: []}}')
    _, values = declare(file=file)
    assert (values.gains, values.topics) == ([], [])
    file.write_text('/test: {ros__parameters: {rate: []}}')
    with pytest.raises(ParameterError, match='rate must be a finite number'):
        declare(file=file)


@pytest.mark.parametrize(
    ('override', 'said'),
    [
        ('rate:=0.5', r'rate must be a finite number in Hz, from 1 to 2000, not 0.5'),
        ('rate:=fast', r"rate must be a finite number in Hz, from 1 to 2000, not 'fast'"),
        ('rate:=.nan', r'rate must be a finite number'),
        ('gains:=[1.0, -1.0]', r'gains must be a list of finite numbers in Nm/rad, at least 0'),
        ('count:=2.5', r'count must be a whole number, at least 1, not 2.5'),
        ('mode:=stop', r"mode must be a string, one of hold, move, not 'stop'"),
        ('enabled:=1', r'enabled must be true or false, not 1'),
        ('topics:=a', r"topics must be a list of strings, not 'a'"),
    ],
)
def test_a_bad_override_ends_the_start_with_advice(declare, override: str, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        declare(override)


def test_live_parameters_change_and_tell(declare) -> None:
    told = []
    node, values = declare(on_change=lambda name, value: told.append((name, value)))
    assert set_parameter(node, 'rate', 200.0) == ''
    assert set_parameter(node, 'rate', 300) == ''
    assert set_parameter(node, 'gains', [1, 2]) == ''
    assert set_parameter(node, 'enabled', True) == ''
    assert told == [('rate', 200.0), ('rate', 300.0), ('gains', [1.0, 2.0]), ('enabled', True)]
    assert (values.rate, values.gains, values.enabled) == (300.0, [1.0, 2.0], True)


BAD = [
    *(('rate', value) for value in (0.0, 2001, math.nan, 'fast')),
    *(('gains', value) for value in ([1.0, -1.0], [math.inf])),
    *(('count', 0), ('mode', 'stop'), ('enabled', 1), ('topics', ['c'])),
]


def test_a_bad_set_is_rejected_and_changes_nothing(declare) -> None:
    node, values = declare(on_change=lambda *_: pytest.fail('a rejected value was told'))
    before = vars(values).copy()
    stored = {name: node.get_parameter(name).value for name in before}
    for name, value in BAD:
        reason = set_parameter(node, name, value)
        assert name in reason or 'type' in reason
    assert vars(values) == before
    assert {name: node.get_parameter(name).value for name in before} == stored


def test_the_descriptor_is_complete(declare) -> None:
    node, _ = declare()
    rate = node.describe_parameter('rate')
    assert rate.description == 'cycles [Hz]'
    assert not rate.read_only
    (bounds,) = rate.floating_point_range
    assert (bounds.from_value, bounds.to_value) == (1.0, 2000.0)
    topics = node.describe_parameter('topics')
    assert topics.read_only
    assert 'set the value at the start' in topics.additional_constraints
    assert 'one of hold, move' in node.describe_parameter('mode').additional_constraints


def test_a_table_that_contradicts_itself_is_refused() -> None:
    one = Parameter('gain', 1.0, 'gain', maximum=2.0)
    with pytest.raises(ValueError, match='the same name'):
        ParameterTable(one, one)
    with pytest.raises(ValueError, match='default value is invalid: parameter gain'):
        ParameterTable(Parameter('gain', 3.0, 'gain', maximum=2.0))


def test_a_node_stays_on_the_system_clock(declare, capfd) -> None:
    node, _ = declare('use_sim_time:=true')
    assert 'use_sim_time has no effect' in capfd.readouterr().err
    assert node.get_parameter('use_sim_time').value is False
    assert node.get_clock().now().nanoseconds * 1e-9 == pytest.approx(time.time(), abs=10.0)
    assert 'use_sim_time has no effect' in set_parameter(node, 'use_sim_time', True)
    assert node.get_clock().now().nanoseconds * 1e-9 == pytest.approx(time.time(), abs=10.0)
    assert set_parameter(node, 'use_sim_time', False) == ''
