"""Reaction of every benchmark to an unknown command line."""

import json
import subprocess
import sys
from pathlib import Path

from source_files import ROOT

GROUPS = ('.', 'real_time', 'model_fits', 'estimation')
BENCHMARKS = [
    script for group in GROUPS for script in sorted((ROOT / 'benchmarks' / group).glob('*.py'))
]
# One process imports what most of them import, and forks for each.
RUN_ALL = """
import importlib, json, os, runpy, sys
from aerarm_ros.executables import command_modules

for module in command_modules().values():
    importlib.import_module(module)

statuses = []
for number, script in enumerate(sys.argv[2:]):
    child = os.fork()
    if child == 0:
        for descriptor, name in ((1, 'out'), (2, 'error')):
            file = os.path.join(sys.argv[1], f'{number}.{name}')
            os.dup2(os.open(file, os.O_CREAT | os.O_WRONLY), descriptor)
        sys.argv = [script, '--nonsense', 'x']
        sys.path.insert(0, os.path.dirname(script))
        status = 0
        try:
            runpy.run_path(script, run_name='__main__')
        except SystemExit as end:
            status = end.code
        sys.stderr.flush()
        os._exit(status)
    statuses.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(json.dumps(statuses))
"""


def test_an_unknown_option_is_one_error_and_measures_nothing(tmp_path: Path) -> None:
    said, here = tmp_path / 'said', tmp_path / 'here'
    said.mkdir()
    here.mkdir()
    command = [sys.executable, '-c', RUN_ALL, str(said), *map(str, BENCHMARKS)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=here, timeout=600)
    assert done.returncode == 0, done.stderr
    for number, (script, status) in enumerate(
        zip(BENCHMARKS, json.loads(done.stdout), strict=True)
    ):
        out, error = ((said / f'{number}.{name}').read_text() for name in ('out', 'error'))
        assert (status, out) == (2, ''), (script, error)
        last = error.splitlines()[-1]
        assert last == f'{script.name}: error: unrecognized arguments: --nonsense x'
    assert not list(here.iterdir())
