"""`arm init`: its files, what it says, what it refuses; no node runs."""

from pathlib import Path
from typing import Any

import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.nodes.arm import main
from aerarm_ros.ros.bridge.hardware_bridge import World

URDF = str(resource('config', 'examples', 'three_joints.urdf'))


def test_both_files_are_written_and_the_next_commands_told(tmp_path: Path, capsys: Any) -> None:
    folder = tmp_path / 'new'
    assert main(['init', URDF, '--name', 'mine', '--out', str(folder)]) == 0
    text = (folder / 'mine.yaml').read_text()
    assert load_arm_config(folder / 'mine.yaml').name == 'mine'
    assert load_excitation_config(folder / 'mine_excitation.yaml').bias is not None
    printed = capsys.readouterr().out
    assert f'{text.count("# guess")} values that no URDF says' in printed
    assert f'-p config:={folder}/mine.yaml -p urdf:={URDF}' in printed


def test_what_was_found_out_is_not_overwritten(tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / 'three_joints_excitation.yaml'
    file.write_text('measured')
    assert main(['init', URDF, '--out', str(tmp_path)]) == 2
    assert 'exists' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert main(['init', URDF, '--out', str(tmp_path), '--overwrite']) == 0
    assert file.read_text() != 'measured'


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['missing.urdf'], 'missing.urdf: No such file'),
        ([URDF, '--locked', 'thumb'], "there is no moving joint 'thumb'"),
        ([URDF, '--out', '/proc/nowhere'], '/proc/nowhere'),
    ],
)
def test_what_cannot_be_done_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['init', *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert (error.startswith('arm init: '), error.count('\n')) == (True, 1)
    assert not list(tmp_path.iterdir())


def test_no_real_motor_is_driven_by_guesses(tmp_path: Path) -> None:
    assert main(['init', URDF, '--out', str(tmp_path)]) == 0
    config: Any = load_arm_config(tmp_path / 'three_joints.yaml')
    nothing: Any = None
    with pytest.raises(ValueError, match='three_joints is for emulated boards'):
        World().make_transport(config, nothing, nothing)
