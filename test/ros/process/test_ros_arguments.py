"""Parameters and remappings of a command line, by node."""

import re
from pathlib import Path

import pytest
from rclpy.context import Context

from aerarm_ros.ros.process.ros_arguments import RosArguments, UsageError

FILE = """
/**:
  ros__parameters:
    use_sim_time: false
/**/excitation:
  ros__parameters:
    seed: !!python/tuple [3]
    limits: {joint1: {effort: 2.0}, joint2.effort: 3.0}
left:
  recorder:
    ros__parameters:
      bag: x
"""


def ros(*arguments: str) -> RosArguments:
    return RosArguments(['--ros-args', *arguments])


def test_own_arguments_are_apart_from_those_for_ros() -> None:
    line = 'a --ros-args -p seed:=1 -r __ns:=/left -- b --ros-args --log-level info --param x:=1'
    arguments = RosArguments(line.split())
    assert arguments.plain == ['a', 'b']
    assert [parameter.name for parameter in arguments.parameters] == ['seed', 'x']


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
    (given,) = ros('-p', rule).parameters
    assert (given.name, given.is_for(node)) == ('seed', is_for)


def test_sections_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(FILE)
    parameters = ros('--params-file', str(file)).parameters

    def names(node: str) -> list[str]:
        return [parameter.name for parameter in parameters if parameter.is_for(node)]

    own = ['use_sim_time', 'seed', 'limits.joint1.effort', 'limits.joint2.effort']
    assert names('/excitation') == names('/right/excitation') == own
    assert names('/left/recorder') == ['use_sim_time', 'bag']
    assert names('/recorder') == ['use_sim_time']
    assert [p.is_for_any_node for p in parameters] == [True, False, False, False, False]


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
    assert ros(*rules).full_name('excitation') == name


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        (b'seed: 3', "'seed' in parameter file"),
        (b'excitation: {seed: 3}', "'excitation/seed' in parameter file"),
        (b'[1, 2]', 'has no section'),
        (b'', 'has no section'),
        (b'a: [', 'is not valid YAML'),
        (b'\xff\xfe\x00', 'is not valid YAML'),
        (None, 'parameters.yaml: No such file'),
    ],
)
def test_a_file_without_parameters_is_rejected(
    tmp_path: Path, content: bytes | None, said: str
) -> None:
    file = tmp_path / 'parameters.yaml'
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(UsageError, match=said):
        ros('--params-file', str(file))


@pytest.mark.parametrize(
    'rule', ['seed=3', 'pace:=', 'player:pace:=', 'pace:=[', 'pace:={a: 1}', 'pace:=a: b']
)
def test_values_that_rcl_cannot_read_are_rejected_before_rcl_starts(rule: str) -> None:
    with pytest.raises(UsageError, match=re.escape(f'-p {rule} is invalid: write -p NAME:=VALUE')):
        ros('-p', rule)


@pytest.mark.parametrize('value', ["''", '[]', '[1, 2]', '!text x', '~', ' ', '/dev/x:=y', '-1e3'])
def test_values_that_rcl_reads_are_accepted(value: str) -> None:
    (given,) = ros('-p', f'pace:={value}').parameters
    assert given.name == 'pace'
    context = Context()
    context.init(['--ros-args', '-p', f'pace:={value}'])  # raises if it cannot
    context.try_shutdown()
