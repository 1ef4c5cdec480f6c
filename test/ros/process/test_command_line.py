"""Help and mistakes of a node's command line; test_help_golden.py has those of every node."""

from pathlib import Path

import pytest

from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import CommandLine
from aerarm_ros.ros.process.ros_arguments import RosArguments, UsageError

PARAMETERS = ParameterTable(
    Parameter('periods', 2, 'how often', '', 1, 10),
    Parameter('gains', [1.0, 2.0], 'stiffness of each joint', 'Nm/rad', 0.0, live=True),
    Parameter('bag', '', 'where it goes'),
)
COMMAND_LINE = CommandLine('player', PARAMETERS, 'Plays a motion.\n\n    Usage: player\n')


def check(*arguments: str) -> list[str]:
    return COMMAND_LINE.check(RosArguments(arguments))


def test_help_lists_every_parameter() -> None:
    text = COMMAND_LINE.help()
    assert 'Plays a motion.\n\nUsage: player\n' in text
    assert '  periods (integer, default 2, from 1 to 10)\n      how often' in text
    assert '  gains (double list [Nm/rad], default [1.0, 2.0], at least 0.0, live)' in text
    assert '  bag (string)\n' in text


def test_help_begins_with_the_node_s_own_parameters() -> None:
    shared = grouped('Which arm', Parameter('urdf', '', 'its nominal parameters'))
    table = ParameterTable(*shared, Parameter('speed', 1.0, 'how fast'))
    lines = CommandLine('player', table, '').help().splitlines()
    order = [lines.index(line) for line in lines if line.startswith(('  speed', 'Which', '  urdf'))]
    assert [lines[k].split()[0] for k in order] == ['speed', 'Which', 'urdf']


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('periods:=3', "unknown argument 'periods:=3': set parameters with --ros-args -p"),
        ('--periods 3', "unknown argument '--periods'"),
        ('--ros-args -p perods:=3', "unknown parameter 'perods' in -p, did you mean 'periods'?"),
        ('--ros-args -p speed:=3', "unknown parameter 'speed' in -p .player --help lists all"),
        ('--ros-args -p player:gain:=[3.0]', "did you mean 'gains'?"),
        (
            '--ros-args -p qos_overrides./joint_states.publisher.depth:=3',
            "unknown parameter 'qos_overrides./joint_states.publisher.depth'",
        ),
        ('--ros-args -p plyer:periods:=3', '-p plyer:periods sets a parameter of the node /plyer'),
    ],
)
def test_unknown_arguments_are_rejected(line: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        check(*line.split())


@pytest.mark.parametrize('name', ['periods', 'use_sim_time', 'start_type_description_service'])
def test_parameters_of_rclpy_are_legal(name: str) -> None:
    assert check('--ros-args', '-p', f'{name}:=1') == []


def check_file(tmp_path: Path, text: str) -> list[str]:
    file = tmp_path / 'parameters.yaml'
    file.write_text(text)
    return check('--ros-args', '--params-file', str(file))


def test_a_files_key_for_this_node_is_refused_with_file_and_hint(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"unknown parameter 'perods' in .*parameters.yaml, did"):
        check_file(tmp_path, '/**/player: {ros__parameters: {perods: 3}}')


def test_other_nodes_parameters_in_a_file_are_no_mistake(tmp_path: Path) -> None:
    text = (
        '/**: {ros__parameters: {speed: 3}}\n'
        'recorder: {ros__parameters: {perods: 3}}\n'
        'player: {ros__parameters: {periods: 3}}\n'
        'player2: {ros__parameters: {perods: 3}}\n'
        'left/player: {ros__parameters: {perods: 3}}\n'
    )
    assert check_file(tmp_path, text) == []


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('/**: {ros__parameters: {perods: 3}}', "did you mean 'periods'?"),
        ('plyer: {ros__parameters: {periods: 3}}', 'the node /player, only for /plyer'),
    ],
)
def test_a_probable_slip_that_may_be_meant_for_another_node_is_a_warning(
    tmp_path: Path, text: str, said: str
) -> None:
    (warning,) = check_file(tmp_path, text)
    assert said in warning
