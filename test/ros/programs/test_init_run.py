"""`arm init`: its files, what it says, what it refuses; no node runs."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.feasibility import FeasibilityReport
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.nodes.arm import main
from aerarm_ros.ros.bridge.hardware_bridge import World
from aerarm_ros.ros.parameters.shared_parameters import load_arm, load_setup

URDF = str(resource('config', 'examples', 'three_joints.urdf'))


def test_both_files_are_written_and_the_next_commands_printed(tmp_path: Path, capsys: Any) -> None:
    folder = tmp_path / 'new'
    assert main(['init', URDF, '--name', 'mine', '--out', str(folder)]) == 0
    text = (folder / 'mine.yaml').read_text()
    assert load_arm_config(folder / 'mine.yaml').name == 'mine'
    assert load_excitation_config(folder / 'mine_excitation.yaml').bias is not None
    printed = capsys.readouterr().out
    assert f'{text.count("# guess")} values are guesses' in printed
    assert f'-p config:={folder}/mine.yaml -p urdf:={URDF}' in printed


def test_existing_files_are_not_overwritten(tmp_path: Path, capsys: Any) -> None:
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
        (['missing.urdf'], 'missing.urdf cannot be read (No such file'),
        ([URDF, '--locked', 'thumb'], "unknown moving joint 'thumb'"),
        ([URDF, '--out', '/proc/nowhere'], '/proc/nowhere'),
    ],
)
def test_impossible_arguments_print_one_line(
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


def _without_collision(folder: Path) -> str:
    tree = ElementTree.parse(URDF)
    for link in tree.getroot().findall('link'):
        for shape in link.findall('collision'):
            link.remove(shape)
    path = folder / 'bare.urdf'
    tree.write(path)
    return str(path)


def _plan(folder: Path, urdf: str) -> FeasibilityReport:
    values = SimpleNamespace(
        config=str(folder / 'three_joints.yaml'),
        urdf=urdf,
        tf_prefix='',
        excitation_config=str(folder / 'three_joints_excitation.yaml'),
        package_directories=[''],
    )
    setup = load_setup(values, *load_arm(values))
    trajectory, report = setup.random_trajectory(0.2, 0.2, 2).draw_feasible(1, setup.checker, 2.0)
    setup.planner.plan(trajectory, 1, np.array(setup.config.bias))
    return report


def test_an_arm_without_collision_shapes_is_drafted_and_moves(tmp_path: Path, capsys: Any) -> None:
    urdf = _without_collision(tmp_path)
    assert main(['init', urdf, '--out', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'no moving link of the URDF has a <collision> shape' in printed
    assert 'check_clearance: false, so motions are NOT checked for collisions' in printed
    report = _plan(tmp_path, urdf)
    assert 'collisions are not checked' in ' '.join(report.notes)


def test_an_estimate_replaces_guesses(tmp_path: Path, capsys: Any) -> None:
    estimate = tmp_path / 'estimate.yaml'
    found = {
        'joint_names': ['elbow', 'turn', 'shoulder'],
        'viscous': [0.02, 0.03, 0.04],
        'coulomb': [0.2, 0.4, 0.5],
        'rotor_inertia': [0.02, 0.1, 0.0],
    }
    estimate.write_text(yaml.safe_dump({'/**': {'ros__parameters': found}}))
    assert main(['init', URDF, '--out', str(tmp_path), '--estimate', str(estimate)]) == 0
    assert 'not in the URDF or estimate' in capsys.readouterr().out
    file = tmp_path / 'three_joints.yaml'
    config = load_arm_config(file)
    assert config.column('viscous') == pytest.approx([0.03, 0.04, 0.02])
    assert config.column('coulomb') == pytest.approx([0.4, 0.5, 0.2])
    inertia = config.column('reflected_inertia')
    assert inertia[[0, 2]] == pytest.approx([0.1, 0.02], rel=1e-3)
    assert inertia[1] > 0.0  # no motor is without a rotor: still a guess
    marks = [line for line in file.read_text().splitlines() if 'rotor_inertia:' in line]
    assert sorted('# guess' in line for line in marks) == [False, False, True]
    robot = load_robot(Path(URDF), joint_names=config.joint_names)
    motion = PolynomialPath.rest_to_rest(np.zeros(3), np.array([1.0, 0.0, 0.0]), 1.5)
    friction = EnergyModel(config, robot).balance(motion).friction
    assert friction[0] > 0.4  # at least the dry friction along 1 rad
    found['joint_names'] = ['other', 'turn', 'shoulder']
    estimate.write_text(yaml.safe_dump({'/**': {'ros__parameters': found}}))
    arguments = ['--out', str(tmp_path), '--estimate', str(estimate), '--overwrite']
    assert main(['init', URDF, *arguments]) == 2
    assert 'has the joints other, turn, shoulder, but not ' in capsys.readouterr().err
