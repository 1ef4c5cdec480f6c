"""Parameters and remappings of a command line, by node."""

import re
from pathlib import Path

import pytest
from rclpy.context import Context

from aerarm_ros.ros.process.ros_arguments import GivenParameter, RosArguments, UsageError

FILE = """
/**:
  ros__parameters:
    use_sim_time: false
/**/excitation:
  ros__parameters:
    seed: 3
    limits: {joint1: {effort: 2.0}, joint2.effort: 3.0}
left:
  recorder:
    ros__parameters:
      bag: x
"""


def names(parameters: list[GivenParameter], node: str) -> list[str]:
    return [parameter.name for parameter in parameters if parameter.is_for(node)]


def test_own_arguments_are_apart_from_those_for_ros() -> None:
    line = 'a --ros-args -p seed:=1 -r __ns:=/left -- b --ros-args --log-level info --param x:=1'
    arguments = RosArguments(line.split())
    assert arguments.plain == ['a', 'b']
    assert [parameter.name for parameter in arguments.parameters] == ['seed', 'x']


def test_an_empty_command_line_has_no_arguments() -> None:
    arguments = RosArguments([])
    assert (arguments.plain, arguments.parameters) == ([], [])
    assert arguments.full_name('excitation') == '/excitation'


@pytest.mark.parametrize(
    ('rule', 'node', 'is_for'),
    [
        ('seed:=1', '/left/excitation', True),
        ('seed:=a:b', '/excitation', True),
        ('excitation:seed:=1', '/excitation', True),
        ('excitation:seed:=1', '/other', False),
    ],
)
def test_a_parameter_is_for_every_node_or_for_the_one_named(rule, node, is_for) -> None:
    (given,) = RosArguments(['--ros-args', '-p', rule]).parameters
    assert given.name == 'seed'
    assert given.is_for(node) == is_for


def test_sections_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(FILE)
    parameters = RosArguments(['--ros-args', '--params-file', str(file)]).parameters
    own = ['use_sim_time', 'seed', 'limits.joint1.effort', 'limits.joint2.effort']
    assert names(parameters, '/excitation') == own
    assert names(parameters, '/right/excitation') == own
    assert names(parameters, '/left/recorder') == ['use_sim_time', 'bag']
    assert names(parameters, '/recorder') == ['use_sim_time']
    assert [p.is_for_any_node for p in parameters] == [True, False, False, False, False]


def test_tags_are_overlooked_as_launch_writes_them(tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text('/**:\n  ros__parameters:\n    joints: !!python/tuple\n    - joint4\n')
    (given,) = RosArguments(['--ros-args', '--params-file', str(file)]).parameters
    assert given.name == 'joints'


@pytest.mark.parametrize(
    ('remaps', 'name'),
    [
        ([], '/excitation'),
        (['__ns:=/left'], '/left/excitation'),
        (['__node:=player', '__ns:=/'], '/player'),
        (['excitation:__name:=player', 'joint_states:=states'], '/player'),
        (['other:__node:=player'], '/excitation'),
    ],
)
def test_the_name_of_a_node_is_the_remapped_one(remaps: list[str], name: str) -> None:
    rules = [part for rule in remaps for part in ('-r', rule)]
    assert RosArguments(['--ros-args', *rules]).full_name('excitation') == name


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        ('seed: 3', "'seed' in parameter file"),
        ('excitation: {seed: 3}', "'excitation/seed' in parameter file"),
        ('[1, 2]', 'has no section'),
        ('a: [', 'is not valid YAML'),
        (b'\xff\xfe\x00', 'is not valid YAML'),
    ],
)
def test_a_file_that_gives_nothing_is_refused(tmp_path: Path, content, said: str) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UsageError, match=said):
        RosArguments(['--ros-args', '--params-file', str(file)])


def test_a_parameter_without_a_value_is_refused() -> None:
    with pytest.raises(UsageError, match='-p seed=3 is invalid: write -p NAME:=VALUE'):
        RosArguments(['--ros-args', '-p', 'seed=3'])


@pytest.mark.parametrize(
    ('rule', 'said'),
    [
        ('pace:=', '-p pace:= has no value: write -p pace:=VALUE'),
        ('player:pace:=', '-p player:pace:= has no value: write -p player:pace:=VALUE'),
        ('pace:=[', 'has no valid value'),
        ('pace:={a: 1}', 'has no valid value'),
        ('pace:=a: b', 'has no valid value'),
    ],
)
def test_values_that_rcl_cannot_read_are_rejected_before_rcl_starts(rule: str, said: str) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        RosArguments(['--ros-args', '-p', rule])


@pytest.mark.parametrize('value', ["''", '[]', '[1, 2]', '!text x', '~', ' ', '/dev/x:=y', '-1e3'])
def test_values_that_rcl_reads_are_accepted(value: str) -> None:
    (given,) = RosArguments(['--ros-args', '-p', f'pace:={value}']).parameters
    assert given.name == 'pace'
    context = Context()
    context.init(['--ros-args', '-p', f'pace:={value}'])  # raises if it cannot
    context.try_shutdown()


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(UsageError, match='/nowhere/p.yaml: No such file'):
        RosArguments(['--ros-args', '--params-file', '/nowhere/p.yaml'])
