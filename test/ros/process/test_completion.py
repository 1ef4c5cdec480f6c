"""Completion of command lines, as bash requests it."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ('line', 'words'),
    [
        ('arm go --t', ['--timeout', '--tolerance']),
        ('arm go 0 --on-contact re', ['report', 'retreat']),
        ('identifier --sol', ['--solvers']),
        ('view --ros-args -p por', ['port:=']),
        ('computed_torque --par', ['--param', '--params-file']),
    ],
)
def test_options_choices_and_parameters_are_completed(line: str, words: list[str]) -> None:
    name = line.split()[0]
    run = f'{sys.executable} -m aerarm_ros.executables'
    script = f"""eval "$({run} arm completion)"
{name}() {{ {run} {name} "$@"; }}
COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; COMP_TYPE=9
complete -p {name} >/dev/null && _python_argcomplete {name}
echo "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(['bash', '-c', script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == words


def test_argcomplete_is_loaded_only_on_request() -> None:
    lines = """import sys
from aerarm_ros.nodes.arm import make_parser
from aerarm_ros.ros.process.ros_arguments import complete
complete(make_parser())
sys.exit('argcomplete' in sys.modules)"""
    assert subprocess.run([sys.executable, '-c', lines]).returncode == 0
