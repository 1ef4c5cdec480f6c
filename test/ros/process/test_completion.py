"""Completion, as bash does it."""

import subprocess

import pytest

from aerarm_ros.ros.parameters.parameter_table import Parameter
from aerarm_ros.ros.process.completion import lazy_script, node_script
from aerarm_ros.ros.process.ros_arguments import COMPLETION, OneLineParser


def completed(script: str, words: str, name: str = 'tool') -> list[str]:
    """Return what bash offers for the last of the words."""
    asked = f'COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))'
    lines = f'{script}\n{asked}\n_{name} {name} 2>/dev/null; echo "${{COMPREPLY[@]}}"'
    done = subprocess.run(['bash', '-c', lines], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_options_and_their_choices(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneLineParser(prog='tool')
    parser.add_argument('--solver', choices=('wls', 'sdp'))
    parser.add_argument('--some', action='store_true')
    with pytest.raises(SystemExit) as ended:
        parser.parse_args([COMPLETION])
    assert ended.value.code == 0
    script = capsys.readouterr().out
    assert completed(script, 'tool --s') == ['--solver', '--some']
    assert completed(script, 'tool --some --solver s') == ['sdp']
    assert completed(script, 'tool --comp') == []  # asked by shells only


def test_parameters_of_a_node() -> None:
    script = node_script('tool', [Parameter('port', 8080, ''), Parameter('host', '', '')])
    assert completed(script, 'tool --ros') == ['--ros-args']
    assert completed(script, 'tool --ros-args -p ho') == ['host:=']


def test_others_are_asked_when_they_are_first_completed() -> None:
    asked = 'tool() { [ "$1" = --completion ] && echo "_tool() { COMPREPLY=(asked \\$2); }"; }'
    script = f'{asked}\n{lazy_script(["tool"])}\n_lazy() {{ _aerarm_lazy tool word; }}'
    assert completed(script, 'tool word', name='lazy') == ['asked', 'word']
