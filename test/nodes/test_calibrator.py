"""The calibrator on tables and on a bag of the emulated arm, up to the bridge's files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from bridge_client import BridgeClient, StartBridge
from forked_executable import run
from measured_arm import ROBOT, MeasuredArm
from rclpy.node import Node

from aerarm_ros.calibration.observations import MarkerSource
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.ros.process.node_process import NodeProcess


def write_table(path: Path, arm: MeasuredArm, q: np.ndarray, scale: float = 1.0) -> Path:
    """Write a table of postures: joints, numbered markers, empty cells, notes."""
    source = arm.observe(q).sources[0]
    assert isinstance(source, MarkerSource)
    header = [f'{axis}{k + 1}' for k in range(len(source.names)) for axis in 'xyz']
    with path.open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow([*header, *ROBOT.joint_names, 'gripper', 'note'])
        for row, markers in zip(q, source.position, strict=True):
            cells = ['' if np.isnan(x) else str(scale * x) for x in markers.ravel()]
            writer.writerow([*cells, *map(str, row), '0.02', 'x'])
    return path


@pytest.fixture(scope='module')
def tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp('tables')
    arm = MeasuredArm(11, frames=10)
    return (
        write_table(folder / 'training.csv', arm, arm.postures(35)),
        write_table(folder / 'held_out.csv', arm, arm.postures(15, seed=1)),
    )


def test_a_table_becomes_urdf_yaml_and_report(tables: tuple[Path, Path], tmp_path: Path) -> None:
    training, held_out = tables
    out = tmp_path / 'result'
    done = run('calibrator', '--bag', training, '--validation', held_out, '--out', out)
    assert done.returncode == 0, done.stderr
    assert 'marker marker1: columns x1, y1, z1 [m]' in done.stderr
    assert 'not used: gripper, note' in done.stderr
    figures = json.loads((out / 'summary.json').read_text())
    held = figures['errors']['held_out']
    assert held['after_mm'] < 0.3 < 1.0 < held['before_mm']
    assert f'{held["after_mm"]:.2f} mm after calibration' in done.stdout
    assert 'calibrated geometry' in load_robot(out / 'calibrated.urdf').urdf_text
    offsets = load_arm_config(out / 'arm.yaml').column('offset')
    listed = yaml.safe_load((out / 'calibration.yaml').read_text())['offsets']
    for joint, (value, _) in listed.items():
        assert offsets[ROBOT.joint_names.index(joint)] == pytest.approx(value, abs=1e-6)
    assert '<h2' in (out / 'report.html').read_text()


def test_without_a_configuration_the_offsets_are_in_the_urdf(
    tables: tuple[Path, Path], tmp_path: Path
) -> None:
    urdf, out = resource('urdf', 'aerarm.urdf'), tmp_path / 'result'
    arguments = ('--bag', tables[0], '--urdf', urdf, '--holdout', '0.2', '--level', 'offsets')
    done = run('calibrator', *arguments, '--out', out)
    assert done.returncode == 0, done.stderr
    assert not (out / 'arm.yaml').exists()
    found = yaml.safe_load((out / 'calibration.yaml').read_text())
    assert (found['offsets_in'], found['geometry']) == ('calibrated.urdf', {})


@pytest.mark.parametrize(
    ('options', 'expected'),
    [
        (('--link', 'wing'), 'link wing (--link) is unknown'),
        (('--holdout', '2'), '--holdout: 2 is invalid: pass a fraction'),
        (('--bag', 'none.csv'), 'check its path'),
        (('--length-unit', 'mm'), 'the URDF does not describe this arm'),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    tables: tuple[Path, Path], tmp_path: Path, options: tuple[str, ...], expected: str
) -> None:
    done = run('calibrator', '--bag', tables[0], *options, '--out', tmp_path / 'result')
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith('calibrator: ') and expected in last
    assert 'Traceback' not in done.stderr
    assert not list(tmp_path.iterdir())


def newest_position(client: BridgeClient) -> np.ndarray:
    client.states.clear()
    client.wait_for(lambda: bool(client.states))
    return np.array(client.states[-1].position)


def test_from_the_ride_of_an_emulated_arm_to_a_bridge_with_its_offsets(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    truth, bag, out = tmp_path / 'truth.yaml', tmp_path / 'bag', tmp_path / 'result'
    place = [0.2, 1.3, -0.3, 0.4]
    made = {'seed': 3, 'geometry_seed': 5, 'initial_position': place}
    bridge = start_bridge(**made, mocap_rate=100.0, mocap_clock=0.08, truth_file=truth)
    client = BridgeClient(ros_node)
    client.wait_for_mode('idle')
    before = newest_position(client)
    with NodeProcess('computed_torque', log=tmp_path / 'controller.log'):
        enabled = run('arm', 'enable', '--timeout', '200', '--wait-before', 'idle',
                      '--wait', 'ready', 'running')  # fmt: skip
        assert enabled.returncode == 0, enabled.stderr
        ride = run('arm', 'calibrate', '--postures', '6', '--rest', '0.7', '--span', '0.4',
                   '--timeout', '200', '--out', str(bag))  # fmt: skip
        assert ride.returncode == 0, ride.stderr + ride.stdout
    bridge.stop()
    assert 'sensors: /mocap/marker1, /mocap/marker2' in ride.stderr
    done = run('calibrator', '--bag', bag, '--out', out)
    assert done.returncode == 0, done.stderr
    assert 'the arm rests in 6 postures' in done.stderr
    figures = json.loads((out / 'summary.json').read_text())
    assert figures['errors']['training']['after_mm'] < 0.5

    # The emulated hardware stays as made; the bridge reads it with calibrated offsets.
    drawn = str(resource('config', 'aerarm.yaml'))
    start_bridge(**made, config=str(out / 'arm.yaml'), hardware_config=drawn)
    client.modes.clear()
    client.wait_for_mode('idle')
    offsets = load_arm_config(out / 'arm.yaml').column('offset')
    np.testing.assert_allclose(newest_position(client) - before, offsets, atol=2e-3)
    true = np.array(yaml.safe_load(truth.read_text())['geometry']['joint_offsets'])
    np.testing.assert_allclose(before, np.array(place) - true, atol=2e-3)
