"""Help and mistakes of a node's command line; test_help_golden.py has those of every node."""

from pathlib import Path

import pytest

from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import CommandLine
from aerarm_ros.ros.process.ros_arguments import RosArguments, UsageError

PARAMETERS = ParameterTable(
    *grouped('Which arm', Parameter('urdf', '', 'its nominal parameters')),
    Parameter('periods', 2, 'how often', '', 1, 10),
    Parameter('gains', [1.0, 2.0], 'stiffness of each joint', 'Nm/rad', 0.0, live=True),
    Parameter('bag', '', 'where it goes'),
)
COMMAND_LINE = CommandLine('player', PARAMETERS, 'Plays a motion.\n\n    Usage: player\n')
HELP = """
Plays a motion.

Usage: player

Parameters (`arm set` changes those marked live while the node runs):
  periods (integer, default 2, from 1 to 10)
      how often
  gains (double list [Nm/rad], default [1.0, 2.0], at least 0.0, live)
      stiffness of each joint
  bag (string)
      where it goes

Which arm:
  urdf (string)
      its nominal parameters"""


def test_help_lists_every_parameter_and_begins_with_the_node_s_own() -> None:
    usage, _, text = COMMAND_LINE.help().partition('\n')
    assert (usage[:13], text) == ('usage: player', HELP)


def check(*arguments: str) -> list[str]:
    return COMMAND_LINE.check(RosArguments(arguments))


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('periods:=3', "unknown argument 'periods:=3': set parameters with --ros-args -p"),
        ('--periods 3', "unknown argument '--periods'"),
        ('--ros-args -p perods:=3', "unknown parameter 'perods' in -p, did you mean 'periods'?"),
        ('--ros-args -p speed:=3', "unknown parameter 'speed' in -p .player --help lists all"),
        ('--ros-args -p player:gain:=[3.0]', "did you mean 'gains'?"),
        ('--ros-args -p plyer:periods:=3', '-p plyer:periods sets a parameter of the node /plyer'),
    ],
)
def test_unknown_arguments_are_rejected(line: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        check(*line.split())


@pytest.mark.parametrize('name', ['periods', 'use_sim_time', 'start_type_description_service'])
def test_parameters_of_rclpy_are_legal(name: str) -> None:
    assert check('--ros-args', '-p', f'{name}:=1') == []


OTHERS = """
/**: {ros__parameters: {speed: 3}}
recorder: {ros__parameters: {perods: 3}}
player: {ros__parameters: {periods: 3}}
player2: {ros__parameters: {perods: 3}}
left/player: {ros__parameters: {perods: 3}}
"""


@pytest.mark.parametrize(
    ('text', 'warnings', 'error'),
    [
        (OTHERS, [], ''),
        # A probable mistake that may be meant for another node.
        ('/**: {ros__parameters: {perods: 3}}', ["did you mean 'periods'?"], ''),
        (
            'plyer: {ros__parameters: {periods: 3}}',
            ['the node /player, only for /plyer: check the spelling'],
            '',
        ),
        ('/**/player: {ros__parameters: {perods: 3}}', [], "unknown parameter 'perods' in"),
    ],
)
def test_the_sections_of_a_file(tmp_path: Path, text: str, warnings: list[str], error: str) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(text)
    try:
        found, problem = check('--ros-args', '--params-file', str(file)), ''
    except UsageError as raised:
        found, problem = [], str(raised)
    assert (len(found), problem[: len(error)]) == (len(warnings), error)
    assert all(words in one for words, one in zip(warnings, found, strict=True))
