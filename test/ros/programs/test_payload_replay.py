"""Command lines that `payload_estimator --bag` rejects."""

from pathlib import Path

import pytest

from aerarm_ros.ros.programs.payload_replay import replay


def empty(folder: Path) -> Path:
    path = folder / 'empty.mcap'
    path.write_bytes(b'')
    return path


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['{bag}'], 'empty.mcap'),
        (['none'], 'none'),
        (['{bag}', '--out', 'there'], 'with --model'),
        (['{bag}', '--model', 'none.yaml'], 'none.yaml'),
        (['{bag}', '--memory', '0'], '--memory must be a finite number in s, from 1.0 to 3600.0'),
        (['{bag}', '--memory', 'nan'], '--memory must be'),
        (['{bag}', '--rate', '100'], '--rate applies to tables'),
        (['{bag}', '--ros-args', '-p', 'memory:=3.0'], 'memory is a parameter of the node'),
    ],
)
def test_user_errors_print_one_line(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = empty(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert replay('payload_estimator', ['--bag', *(a.format(bag=bag) for a in arguments)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('payload_estimator: ')
    assert words in line
    assert list(tmp_path.iterdir()) == [bag]
