"""Reaction of every benchmark to an unknown command line."""

import subprocess
import sys
from pathlib import Path

import pytest
from source_files import ROOT

GROUPS = ('.', 'real_time', 'model_fits', 'estimation')
BENCHMARKS = [
    script for group in GROUPS for script in sorted((ROOT / 'benchmarks' / group).glob('*.py'))
]


@pytest.mark.parametrize('script', BENCHMARKS, ids=lambda script: script.stem)
def test_an_unknown_option_is_one_error_and_measures_nothing(script: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(script), '--nonsense', 'x']
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert (done.returncode, done.stdout) == (2, '')
    last = done.stderr.splitlines()[-1]
    assert last == f'{script.name}: error: unrecognized arguments: --nonsense x'
    assert not list(tmp_path.iterdir())
