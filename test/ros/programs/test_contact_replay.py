"""What the command line of `contact_estimator --bag` rejects."""

from pathlib import Path

import pytest

from aerarm_ros.ros.programs.contact_replay import contact_replay


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--bag', '{bag}'], 'pass --free BAG'),
        (['--bag', '{bag}', '--free', '{bag}', '--residuals', 'x'], 'pass --free BAG'),
        (['--free', '{bag}'], 'no recording to search'),
        (['--free', '{bag}', '--bag', '{bag}'], 'empty.mcap'),
        (['--bag', '{bag}', '--residuals', 'none.yaml'], 'none.yaml'),
        (['--bag', '{bag}', '--free', '{bag}', '--confirmation', '0'], '--confirmation must be'),
        (['--bag', '{bag}', '--free', '{bag}', '--model', 'none.yaml'], 'none.yaml'),
        (['--bag', '{bag}', '--ros-args', '-p', 'rate:=3.0'], 'rate is a parameter of the node'),
    ],
)
def test_user_errors_print_one_line(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = tmp_path / 'empty.mcap'
    bag.write_bytes(b'')
    monkeypatch.chdir(tmp_path)
    assert contact_replay('contact_estimator', [a.format(bag=bag) for a in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('contact_estimator: ')
    assert words in line
    assert list(tmp_path.iterdir()) == [bag]
