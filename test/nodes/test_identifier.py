"""The identifier as a user runs it: one process, bags as input, files as output."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from identifier_process import JOINTS, fresh_identifier, identifier, measured, motion, write_bag

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import from_pseudo_inertia

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


def test_the_summary_contains_the_results(run: tuple[str, Path]) -> None:
    summary = json.loads((run[1] / 'summary.json').read_text())
    assert summary['samples'] == 4000
    assert summary['regressor']['thesis']['rank'] == 30
    sdp, cad = (summary['solvers'][name] for name in ('sdp', 'cad'))
    assert sdp['physically_consistent']
    assert sdp['min_pseudo_inertia_eigenvalue'] > 0.0
    assert sdp['validation'][0]['bag'] == 'validation'
    assert sdp['validation'][0]['filtered'] < 0.2 * cad['validation'][0]['filtered']
    assert summary['conditioning']['fundamental'] == pytest.approx(0.1)
    assert summary['seconds']['total'] == pytest.approx(
        sum(value for key, value in summary['seconds'].items() if key != 'total')
    )


def test_a_payload_is_weighed_and_slow_solvers_run_on_demand(
    bags: Path, robot: Robot, tmp_path: Path
) -> None:
    stamp, q, dq, ddq = motion(3)
    loaded = np.array(robot.inertial_parameters)
    point = np.array([0.1, 0.0, 0.0, 1.0])
    loaded[-1] += from_pseudo_inertia(
        0.25 * (np.outer(point, point) + 1e-3 * np.diag([1, 1, 1, 0]))
    )
    # `measured` makes the arm a fifth heavier, and displaces its matter, as without payload.
    tau = measured(robot.with_inertial_parameters(loaded), q, dq, ddq)
    write_bag(tmp_path / 'carrying', stamp, (q, dq, tau))
    out = tmp_path / 'out'
    done = identifier(
        *('--bag', bags / 'identification', '--payload', tmp_path / 'carrying', '--out', out),
        *('--solvers', 'entropic'),
    )
    assert done.returncode == 0, done.stderr
    assert 'Payload: 0.' in done.stdout
    payload = yaml.safe_load((out / 'payload.yaml').read_text())['/**']['ros__parameters']
    assert payload['payload']['mass'] == pytest.approx(0.3, rel=0.02)
    assert len(payload['inertial_parameters']) == 40
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['payload']['mass'] == payload['payload']['mass']
    assert set(summary['solvers']) == {'cad', 'cad_friction', 'ols', 'entropic', 'sdp'}
    assert 'carried by link4' in (out / 'report.html').read_text()


def test_estimate_loads_as_ros_parameters(run: tuple[str, Path], ros_domain: object) -> None:
    file = run[1] / 'estimate.yaml'
    rclpy.init(args=['--ros-args', '--params-file', str(file)])
    try:
        node = rclpy.create_node('any', automatically_declare_parameters_from_overrides=True)
        assert list(node.get_parameter('joint_names').value) == list(JOINTS)
        rotor = np.array(node.get_parameter('rotor_inertia').value)
        assert rotor[2:] == pytest.approx([0.015] * 2, rel=0.1)
        assert len(node.get_parameter('inertial_parameters').value) == 40
        assert len(node.get_parameter('friction.coulomb').value) == 4
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_same_bags_same_bits(bags: Path, run: tuple[str, Path], tmp_path: Path) -> None:
    out = tmp_path / 'again'
    done = fresh_identifier(
        *('--bag', bags / 'identification', '--validation', bags / 'validation', '--out', out)
    )
    assert done.returncode == 0
    for name in ('estimate.yaml', 'identified.urdf'):
        assert (out / name).read_bytes() == (run[1] / name).read_bytes()


def test_truth_holdout_and_options(bags: Path, tmp_path: Path, robot: Robot) -> None:
    names = [f'{p}_{link}' for link in robot.link_names for p in ('m', 'mcx', 'mcy', 'mcz')]
    names += [
        f'{p}_{link}'
        for link in robot.link_names
        for p in ('Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
    ]
    truth = tmp_path / 'truth.yaml'
    truth.write_text(yaml.safe_dump({'parameters': dict.fromkeys(names, 0.01)}))
    done = identifier(
        *('--bag', bags / 'identification', '--holdout', 0.4, '--friction', 'coulomb'),
        *('--truth', truth, '--cutoff', 4, '--out', tmp_path / 'out', '--gravity', 0, 0, -9.81),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['conditioning']['cutoff'] == 4.0
    (held_out,) = summary['solvers']['sdp']['validation']
    assert held_out['bag'] == 'identification [last 40 %]'
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
        *('--friction', 'coulomb', '--filter', 'butterworth', '--out', tmp_path / 'out'),
    )
    assert done.returncode == 0, done.stderr
    assert 'the effort of joint2 has the opposite sign' in done.stderr
    assert 'repeats every 10 s' in done.stderr
    assert f'{tmp_path / "out"}: the new result replaced an earlier result' in done.stderr
    assert 'RuntimeWarning' not in done.stderr


def test_a_truncated_bag_without_metadata_is_used_with_a_warning(
    bags: Path, tmp_path: Path
) -> None:
    bag = Path(shutil.copytree(bags / 'identification', tmp_path / 'bag'))
    (bag / 'metadata.yaml').unlink()
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[: int(0.8 * file.stat().st_size)])
    out = tmp_path / 'out'
    done = identifier('--bag', bag, '--out', out)
    assert done.returncode == 0, done.stderr
    warnings = json.loads((out / 'summary.json').read_text())['warnings']
    assert any('is cut off' in text for text in warnings)
    for text in (done.stderr, (out / 'report.html').read_text()):
        assert 'the recording may be incomplete' in text
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['bags']['bag']['used'].endswith('(joint_command)')


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
