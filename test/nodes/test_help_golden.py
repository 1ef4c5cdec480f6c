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

import pytest

from aerarm_ros.executables import command_modules

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / 'test' / 'golden' / 'help'
AGAIN = 'RECORD=1 python -m pytest test/nodes/test_help_golden.py records it again'
# One process prints all: most of the time of a help goes into its imports.
PRINT_ALL = """
import contextlib, io, json, sys
from aerarm_ros import executables

texts = {}
for command in json.loads(sys.argv[1]):
    name, *arguments = sys.argv = [*command, '--help']
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
        getattr(executables, name)()
    texts[' '.join(command)] = out.getvalue()
print(json.dumps(texts))
"""


def printed(commands: list[list[str]]) -> dict[str, str]:
    """Return the help text of each command, at a width of 80 columns."""
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith('_ARGCOMPLETE')},
        'COLUMNS': '80',
        'NO_COLOR': '1',
    }
    done = subprocess.run(
        [sys.executable, '-c', PRINT_ALL, json.dumps(commands)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300.0,
    )
    assert done.returncode == 0, done.stderr
    texts: dict[str, str] = json.loads(done.stdout)
    return texts


@pytest.fixture(scope='module')
def helps() -> dict[str, str]:
    names = list(command_modules())
    texts = printed([[name] for name in names])
    orders = re.findall(r'^    ([a-z]\w+)(?:  |$)', texts['arm'], flags=re.MULTILINE)
    assert 'enable' in orders
    return texts | printed([['arm', order] for order in orders])


def test_help_is_as_recorded(helps: dict[str, str]) -> None:
    texts = {f'{command.replace(" ", "_")}.txt': text for command, text in helps.items()}
    if os.environ.get('RECORD'):
        for stale in GOLDEN.glob('*.txt'):
            stale.unlink()
        for name, text in texts.items():
            (GOLDEN / name).write_text(text)
    assert {path.name for path in GOLDEN.glob('*.txt')} == set(texts), AGAIN
    for name, text in texts.items():
        # Versions of Python break lines in different places.
        assert text.split() == (GOLDEN / name).read_text().split(), f'{name}: {AGAIN}'
