"""Reaction of every benchmark to an unknown command line."""

from pathlib import Path

from forked_executable import run
from source_files import ROOT

GROUPS = ('.', 'real_time', 'model_fits', 'estimation')


def test_an_unknown_option_is_one_error_and_measures_nothing(tmp_path: Path) -> None:
    for group in GROUPS:
        for script in (ROOT / 'benchmarks' / group).glob('*.py'):
            done = run(str(script), '--nonsense', 'x', cwd=tmp_path)
            assert (done.returncode, done.stdout) == (2, ''), (script, done.stderr)
            last = done.stderr.splitlines()[-1]
            assert last == f'{script.name}: error: unrecognized arguments: --nonsense x'
    assert not list(tmp_path.iterdir())
