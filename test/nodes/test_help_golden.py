"""The `--help` of every executable and `arm` command, compared with test/golden/help.

RECORD=1 in the environment records the texts again: check the difference before committing.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from aerarm_ros.executables import command_modules

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / 'test' / 'golden' / 'help'
AGAIN = 'RECORD=1 python -m pytest test/nodes/test_help_golden.py records it again'
# One process runs all: most of the time of a help goes into its imports.
RUN_ALL = """
import contextlib, io, json, sys
from aerarm_ros import executables

done = {}
for command in json.loads(sys.argv[1]):
    name, *arguments = sys.argv = command
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            status = getattr(executables, name)()
        except SystemExit as end:
            status = end.code or 0
    done[' '.join(command)] = (status, out.getvalue(), error.getvalue())
print(json.dumps(done))
"""


def run_all(commands: list[list[str]], folder: Path) -> dict[str, tuple[int, str, str]]:
    """Return status, output and errors of each command, at a width of 80 columns."""
    environment = {**os.environ, 'COLUMNS': '80', 'NO_COLOR': '1'}
    done = subprocess.run(
        [sys.executable, '-c', RUN_ALL, json.dumps(commands)],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300.0,
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert not list(folder.iterdir())
    ends: dict[str, tuple[int, str, str]] = json.loads(done.stdout)
    return ends


def helps(commands: list[str], folder: Path) -> dict[str, str]:
    """Return the help of each command, which starts nothing."""
    ends = run_all([[*command.split(), '--help'] for command in commands], folder)
    for command, (status, text, error) in ends.items():
        assert (status, text[:7], error) == (0, 'usage: ', ''), command
    return {command.removesuffix(' --help'): text for command, (_, text, _) in ends.items()}


def test_help_is_as_recorded(tmp_path: Path) -> None:
    all_helps = helps(list(command_modules()), tmp_path)
    orders = re.findall(r'^    ([a-z]\w+)(?:  |$)', all_helps['arm'], flags=re.MULTILINE)
    assert 'enable' in orders
    all_helps |= helps([f'arm {order}' for order in orders], tmp_path)
    texts = {f'{command.replace(" ", "_")}.txt': text for command, text in all_helps.items()}
    if os.environ.get('RECORD'):
        for stale in GOLDEN.glob('*.txt'):
            stale.unlink()
        for name, text in texts.items():
            (GOLDEN / name).write_text(text)
    assert {path.name for path in GOLDEN.glob('*.txt')} == set(texts), AGAIN
    for name, text in texts.items():
        # Versions of Python break lines in different places.
        assert text.split() == (GOLDEN / name).read_text().split(), f'{name}: {AGAIN}'


def test_no_executable_starts_with_an_unknown_argument(
    ros_domain: dict[str, str], tmp_path: Path
) -> None:
    ends = run_all([[name, '--nonsense'] for name in command_modules()], tmp_path)
    assert len(ends) == len(command_modules())
    for command, (status, text, error) in ends.items():
        assert (status, text) == (2, ''), command
        assert error and 'Traceback' not in error
