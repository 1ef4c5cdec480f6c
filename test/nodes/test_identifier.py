"""The identifier as a user runs it: one process, bags as input, files as output."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from identifier_process import fresh_identifier, identifier, measured, motion, write_bag

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import PARAMETER_NAMES

FILES = ['estimate.yaml', 'identified.sdf', 'identified.urdf', 'identified.xml', 'report.html']
FILES += ['summary.json']


@pytest.fixture(scope='module')
def run(bags: Path, made_once: Callable[[str, Callable[[Path], None]], Path]) -> tuple[str, Path]:
    """Standard output and result folder of a good run, started as a launch file does."""

    def fill(folder: Path) -> None:
        out = folder / 'run' / 'result'
        out.parent.mkdir()
        done = identifier(
            *('--bag', bags / 'identification', '--validation', bags / 'validation', '--out', out),
            *('--config', '', '--urdf', '', '--ros-args', '-r', '__node:=identifier'),
        )
        assert done.returncode == 0, done.stderr
        (folder / 'printed').write_text(done.stdout)

    folder = made_once('identifier_run', fill)
    return (folder / 'printed').read_text(), folder / 'run' / 'result'


def test_all_files_are_there(run: tuple[str, Path]) -> None:
    output, out = run
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert [path.name for path in out.parent.iterdir()] == ['result']
    assert str(out / 'report.html') in output
    assert 'identification: used 0.0 .. 20.0 s of 20.0 s (joint_command)' in output
    assert [line.split()[0] for line in output.splitlines()[3:8]] == [
        *('cad', 'cad_friction', 'ols', 'wls', 'sdp')
    ]


def test_same_bags_same_bits(bags: Path, run: tuple[str, Path], tmp_path: Path) -> None:
    out = tmp_path / 'again'
    done = fresh_identifier(
        *('--bag', bags / 'identification', '--validation', bags / 'validation', '--out', out)
    )
    assert done.returncode == 0
    for name in ('estimate.yaml', 'identified.urdf'):
        assert (out / name).read_bytes() == (run[1] / name).read_bytes()


def test_truth_holdout_and_options(bags: Path, tmp_path: Path, robot: Robot) -> None:
    names = [f'{p}_{link}' for link in robot.link_names for p in PARAMETER_NAMES]
    truth = tmp_path / 'truth.yaml'
    truth.write_text(yaml.safe_dump({'parameters': dict.fromkeys(names, 0.01)}))
    done = identifier(
        *('--bag', bags / 'identification', '--holdout', 0.4, '--friction', 'coulomb'),
        *('--solvers', 'entropic', '--truth', truth, '--cutoff', 4, '--out', tmp_path / 'out'),
        *('--gravity', 0, 0, -9.81),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['conditioning']['cutoff'] == 4.0
    (held_out,) = summary['solvers']['sdp']['validation']
    assert held_out['bag'] == 'identification [last 40 %]'
    assert set(summary['solvers']) == {'cad', 'cad_friction', 'ols', 'entropic', 'sdp'}
    assert len(summary['inertial_torque_error']) == 10


def test_renamed_and_amperes(bags: Path, tmp_path: Path, robot: Robot) -> None:
    """Other joint names, torque as current of a motor with 0.5 Nm/A; then a wrong sign."""
    stamp, q, dq, ddq = motion(1)
    names = ('a', 'joint2', 'joint3', 'joint4')
    tau = measured(robot, q, dq, ddq) / [0.5, 1.0, 1.0, 1.0]
    bag = write_bag(tmp_path / 'other', stamp, (q, dq, tau), names, '/arm/joint_states')
    done = identifier(
        *('--bag', bag, '--topic', '/arm/joint_states', '--rename', 'a=joint1'),
        *('--effort-gain', 'joint1=0.5', '--out', tmp_path / 'out', '--friction', 'coulomb'),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['solvers']['sdp']['identification'][0]['filtered'] < 2.0
    done = identifier(
        *('--bag', bags / 'identification', '--effort-gain', 'joint2=-1', '--fundamental', 0.13),
        *('--friction', 'coulomb', '--out', tmp_path / 'out'),
    )
    assert done.returncode == 0, done.stderr
    assert 'the effort of joint2 has the opposite sign' in done.stderr
    assert 'repeats every 10 s' in done.stderr
    assert f'{tmp_path / "out"}: the new result replaced an earlier result' in done.stderr
    assert 'RuntimeWarning' not in done.stderr


def test_names_from_outside_are_escaped(tmp_path: Path, robot: Robot, bags: Path) -> None:
    """A joint, a link and a bag whose names are HTML."""
    nasty = '<script>alert(1)</script>'
    escaped = nasty.replace('<', '&lt;').replace('>', '&gt;')
    urdf = tmp_path / 'nasty.urdf'
    urdf.write_text(
        robot.urdf_text.replace('"joint3"', f'"{escaped}"').replace('"link3"', f'"{escaped}"')
    )
    bag = tmp_path / '<img src=x onerror=alert(2)>'
    shutil.copytree(bags / 'identification', bag)
    done = identifier(
        *('--bag', bag, '--urdf', urdf, '--rename', f'joint3={nasty}', '--out', tmp_path / 'out')
    )
    assert done.returncode == 0, done.stderr
    html = (tmp_path / 'out' / 'report.html').read_text()
    assert nasty not in html
    assert '<img' not in html.split('</head>')[1]
    assert load_robot(tmp_path / 'out' / 'identified.urdf').joint_names[2] == nasty
