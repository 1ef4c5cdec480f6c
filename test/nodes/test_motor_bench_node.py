"""The motor bench as a process against fake_hardware as a process, over real DDS."""

import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from bridge_client import BridgeClient, StartBridge
from forked_executable import run
from rclpy.node import Node

from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedHeat
from aerarm_ros.ros.process.node_process import NodeProcess

QUICK = {
    'joints': ['joint4'],
    'speeds': [1.2, 2.0],
    'span': 1.0,
    'runs': 1,
    'wait_timeout': 60,
    # A machine that tests share may pause.
    'state_timeout': 10.0,
    'tracking_limit': 1.0,
}
FILES = ['bag', 'config.yaml', 'motor_bench.yaml', 'report.html', 'summary.json']


def given(tmp_path: Path, **parameters: object) -> dict[str, object]:
    return {**QUICK, 'out': tmp_path / 'results' / 'out', **parameters}


def start(tmp_path: Path) -> NodeProcess:
    return NodeProcess('motor_bench', (), given(tmp_path), log=tmp_path / 'bench.log')


def refusal(tmp_path: Path, **parameters: object) -> str:
    """Return the output and the exit status."""
    done = run('motor_bench', parameters=given(tmp_path, **parameters))
    assert done.returncode == 1
    return done.stderr + done.stdout


def test_measures_a_drive_of_the_emulated_arm(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    truth_file = tmp_path / 'truth.yaml'
    start_bridge(truth_file=truth_file)
    BridgeClient(ros_node).make_ready()
    with start(tmp_path) as node:
        assert node.wait(120.0) == 0, node.tail()
        assert 'joint4  MN4006' in node.tail()
    out = tmp_path / 'results' / 'out'
    assert sorted(path.name for path in out.iterdir()) == FILES
    truth = yaml.safe_load(truth_file.read_text())
    measured = yaml.safe_load((out / 'motor_bench.yaml').read_text())['joints']['joint4']
    scale = truth['measured_per_true_torque'][3]
    # Accuracy is tested in simulated time (test_motor_bench.py of the identification room): a
    # machine that tests share misses half of the cycles, and the torque of a cycle is then vague.
    coulomb = scale * truth['parameters']['fs_joint4']
    assert 0.4 * coulomb < measured['coulomb'][0] < 2.0 * coulomb
    rotor = scale * truth['parameters']['Ja_joint4'] / 27**2
    assert 0.4 * rotor < measured['rotor_inertia'][0] < 2.0 * rotor
    config = load_arm_config(out / 'config.yaml')
    assert config.joints[3].coulomb == measured['coulomb'][0]
    # Its frames carry no voltage: it is what the board states, of a motor that is hardly warm.
    assert measured['resistance_from'] == 'board'
    true = EmulatedHeat.of_joint(load_arm_config().joints[3], truth['seed']).resistance
    assert config.joints[3].motor.resistance == pytest.approx(true, abs=1e-4)
    assert config.joints[3].motor.resistance_std == pytest.approx(0.1 * true, abs=1e-5)
    states = read_joint_states(out / 'bag')
    assert states.names == config.joint_names
    assert np.abs(states.velocity[:, 3]).max() > 1.5


def test_sigint_stops_the_arm_and_leaves_nothing(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    start_bridge()
    client = BridgeClient(ros_node)
    client.make_ready()
    with start(tmp_path) as node:
        client.wait_for(lambda: bool(client.states) and abs(client.states[-1].velocity[3]) > 0.5)
        assert node.stop(signal.SIGINT) == 130
        assert 'stopped, so it wrote no files' in node.tail()
    client.wait_for(lambda: abs(client.states[-1].velocity[3]) < 0.05)
    assert not (tmp_path / 'results').exists()


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'joints': ['elbow']}, 'unknown joint elbow'),
        ({'wait_timeout': 0.5}, 'the motion could not start within 0.5 s: '),
        ({'speeds': [0.5]}, 'two or more different'),
        ({'posture': [0.0, 1.5]}, 'posture has 2 values'),
        ({'without_mass': '/nowhere/motor_bench.yaml'}, '/nowhere/motor_bench.yaml'),
        ({'known_mass': 0.2, 'known_mass_position': [0.1]}, 'set x, y and z'),
        ({'config': '/nowhere/arm.yaml'}, '/nowhere/arm.yaml'),
    ],
)
def test_bad_input_is_one_line(
    ros_domain: dict[str, str], tmp_path: Path, parameters: dict, message: str
) -> None:
    log = refusal(tmp_path, **parameters)
    assert message in log
    assert 'Traceback' not in log
    assert len(log.splitlines()) == 1
