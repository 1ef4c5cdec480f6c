"""Completion, as bash does it."""

import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.nodes.arm import _completion

TOOL = """
from aerarm_ros.ros.process.ros_arguments import OneLineParser
parser = OneLineParser(prog='tool')
parser.add_argument('--solver', choices=('wls', 'sdp'))
parser.add_argument('--some', action='store_true')
parser.parse_args()
raise SystemExit('it ran')
"""
NODE = """
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import CommandLine
table = ParameterTable(Parameter('port', 8080, ''), Parameter('host', '', ''))
CommandLine('tool', table, None).complete()
raise SystemExit('it ran')
"""


def completed(folder: Path, program: str, line: str) -> list[str]:
    """Return what bash offers for the last word of a line that runs a program."""
    tool = folder / 'tool'
    tool.write_text(f'#!{sys.executable}\n{program}')
    tool.chmod(0o755)
    lines = f"""{_completion()}
COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; COMP_TYPE=9
_python_argcomplete {tool}
echo "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(['bash', '-c', lines], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ('line', 'words'), [('tool --s', ['--solver', '--some']), ('tool --some --solver s', ['sdp'])]
)
def test_options_and_their_choices(tmp_path: Path, line: str, words: list[str]) -> None:
    assert completed(tmp_path, TOOL, line) == words


@pytest.mark.parametrize(
    ('line', 'words'), [('tool --ros', ['--ros-args']), ('tool --ros-args -p ho', ['host:='])]
)
def test_parameters_of_a_node(tmp_path: Path, line: str, words: list[str]) -> None:
    assert completed(tmp_path, NODE, line) == words


def test_completion_is_loaded_only_on_request() -> None:
    lines = TOOL.replace('parser.parse_args()', 'parser.parse_args([])\nimport sys')
    lines = lines.replace("'it ran'", "int('argcomplete' in sys.modules)")
    assert subprocess.run([sys.executable, '-c', lines]).returncode == 0
