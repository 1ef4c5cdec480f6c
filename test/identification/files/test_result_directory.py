"""A result is complete or not there."""

from pathlib import Path

import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory


def test_files_appear_together(tmp_path: Path) -> None:
    target = tmp_path / 'a' / 'b' / 'result'
    with ResultDirectory(target) as directory:
        directory.write('x.txt', 'ä')
        directory.write_json(MARKER, {'a': 1})
        assert not target.exists()
    assert sorted(p.name for p in target.iterdir()) == [MARKER, 'x.txt']
    assert [p.name for p in target.parent.iterdir()] == ['result']


@pytest.mark.parametrize('error', [ValueError, KeyboardInterrupt])
def test_an_error_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), ResultDirectory(tmp_path / 'a' / 'result') as directory:
        directory.write('x.txt', 'text')
        raise error
    assert not list(tmp_path.iterdir())


def test_an_earlier_result_is_replaced_only_by_a_complete_one(tmp_path: Path) -> None:
    target = tmp_path / 'result'
    with ResultDirectory(target) as directory:
        directory.write(MARKER, 'first')
    with pytest.raises(ValueError, match='stop'), ResultDirectory(target) as directory:
        directory.write(MARKER, 'second')
        raise ValueError('stop')
    assert (target / MARKER).read_text() == 'first'
    with ResultDirectory(target) as directory:
        directory.write(MARKER, 'third')
    assert (target / MARKER).read_text() == 'third'
    assert [p.name for p in tmp_path.iterdir()] == ['result']


@pytest.mark.parametrize('files', [(MARKER, 'estimate.yaml'), (MARKER, 'report.html', 'notes.md')])
def test_a_result_with_anything_else_is_not_replaced(tmp_path: Path, files: tuple) -> None:
    """Somebody's notes, or what another program wrote with a marker of the same name."""
    for name in files:
        (tmp_path / name).write_text('old')
    directory = ResultDirectory(tmp_path, files=(MARKER, 'report.html'))
    with (
        pytest.raises(IdentificationError, match=rf'contains other files \({files[-1]}\)'),
        directory,
    ):
        pytest.fail('nothing should be computed')
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(files)


def test_impossible_places_are_noticed_at_once(tmp_path: Path) -> None:
    file, mine = tmp_path / 'file', tmp_path / 'mine'
    mine.mkdir()
    (mine / 'thesis.tex').write_text('years of work')
    file.write_text('')
    for target in (file, file / 'below', Path('/proc/none/result'), mine):
        with pytest.raises(IdentificationError, match='--out'), ResultDirectory(target):
            pytest.fail('nothing should be computed')
    assert (mine / 'thesis.tex').exists()
