"""Command lines that `contact_estimator --bag` and `payload_estimator --bag` reject."""

from pathlib import Path

import pytest

from aerarm_ros.ros.programs.contact_replay import contact_replay
from aerarm_ros.ros.programs.payload_replay import replay

CONTACT, PAYLOAD = 'contact_estimator', 'payload_estimator'


@pytest.mark.parametrize(
    ('name', 'arguments', 'words'),
    [
        (CONTACT, '', 'pass --free BAG'),
        (CONTACT, '--free BAG --residuals x', 'pass --free BAG'),
        (CONTACT, '--free BAG', 'empty.mcap'),
        (CONTACT, '--residuals none.yaml', 'none.yaml'),
        (CONTACT, '--free BAG --confirmation 0', '--confirmation must be'),
        (CONTACT, '--free BAG --model none.yaml', 'none.yaml'),
        (CONTACT, '--free BAG --payload -1 0 0 0', 'pass a positive mass'),
        (CONTACT, '--ros-args -p rate:=3.0', 'rate is a parameter of the node'),
        (PAYLOAD, '', 'empty.mcap'),
        (PAYLOAD, '--out there', 'with --model'),
        (PAYLOAD, '--model none.yaml', 'none.yaml'),
        (PAYLOAD, '--memory 0', '--memory must be a finite number in s, from 1.0 to 3600.0'),
        (PAYLOAD, '--memory nan', '--memory must be'),
        (PAYLOAD, '--rate 100', '--rate applies to tables'),
        (PAYLOAD, '--ros-args -p memory:=3.0', 'memory is a parameter of the node'),
    ],
)
def test_user_errors_print_one_line(
    name: str,
    arguments: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = tmp_path / 'empty.mcap'
    bag.write_bytes(b'')
    monkeypatch.chdir(tmp_path)
    run = contact_replay if name == CONTACT else replay
    given = arguments.replace('BAG', str(bag)).split()
    assert run(name, ['--bag', str(bag), *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'{name}: ')
    assert words in line
    assert list(tmp_path.iterdir()) == [bag]


def test_thresholds_alone_need_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert contact_replay(CONTACT, ['--free', 'bag']) == 2
    assert 'no recording to search' in capsys.readouterr().err
