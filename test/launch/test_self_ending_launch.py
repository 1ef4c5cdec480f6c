"""Launch files that end automatically, with ros2 launch: their output and exit status.

launch_testing counts such an end as a failure, so these tests run them as commands.
"""

import json
import re
from pathlib import Path

import pytest
import yaml
from launched import needs_ros2_launch, ros2_launch

from aerarm_ros.description.resources import resource

pytestmark = needs_ros2_launch
SHORT_BENCH = {'speeds': [0.8, 1.6], 'span': 1.2, 'runs': 2}


@pytest.fixture
def renamed_urdf(tmp_path: Path) -> Path:
    path = tmp_path / 'my_arm.urdf'
    text = resource('urdf', 'aerarm.urdf').read_text()
    path.write_text(re.sub(r'\bjoint([1-4])\b', r'axis\1', text))
    return path


def test_identification_leaves_a_model(tmp_path: Path, ros_domain: dict[str, str]) -> None:
    out = tmp_path / 'run'
    arguments = (f'out:={out}', 'periods:=1', 'namespace:=/launched')
    status, output = ros2_launch('identification', *arguments)
    assert status == 0, output[-3000:]
    summary = json.loads((out / 'result' / 'summary.json').read_text())
    assert summary['solvers']['sdp']['physically_consistent']


def test_motor_bench_leaves_a_drive(tmp_path: Path, ros_domain: dict[str, str]) -> None:
    parameters, out = tmp_path / 'parameters.yaml', tmp_path / 'bench'
    parameters.write_text(yaml.safe_dump({'/**/motor_bench': {'ros__parameters': SHORT_BENCH}}))
    arguments = (f'out:={out}', 'joints:=[joint4]', f'params_file:={parameters}')
    status, output = ros2_launch('motor_bench', *arguments)
    assert status == 0, output[-3000:]
    assert list(yaml.safe_load((out / 'motor_bench.yaml').read_text())['joints']) == ['joint4']


def test_experiment_leaves_a_page(tmp_path: Path, ros_domain: dict[str, str]) -> None:
    arguments = (f'out:={tmp_path}', 'only:=gravity compensation; CAD; still')
    status, output = ros2_launch('experiment', *arguments)
    assert status == 0, output[-3000:]
    assert (tmp_path / 'controllers.html').exists()


@pytest.mark.parametrize(
    ('file', 'argument', 'node', 'reason'),
    [
        ('experiment', 'only:=nothing of this name', 'experiment', "'nothing of this name'"),
        ('motor_bench', 'joints:=[elbow]', 'motor_bench', 'no joint elbow'),
        ('identification', 'urdf:={renamed_urdf}', 'excitation', '{renamed_urdf}: '),
    ],
)
def test_a_node_that_fails_is_exit_status_1(
    file: str,
    argument: str,
    node: str,
    reason: str,
    renamed_urdf: Path,
    tmp_path: Path,
    ros_domain: dict[str, str],
) -> None:
    argument, reason = (text.format(renamed_urdf=renamed_urdf) for text in (argument, reason))
    status, output = ros2_launch(file, argument, f'out:={tmp_path / "out"}')
    assert status == 1, output[-3000:]
    (said,) = [line for line in output.splitlines() if line.startswith(f'[{node}-')]
    assert reason in said
    assert f'Caught exception in launch (see debug for traceback): {node}: exit status 1' in output


@pytest.mark.parametrize('file', ['bringup', 'identification', 'motor_bench'])
def test_launch_ends_if_the_bridge_fails(
    file: str, tmp_path: Path, ros_domain: dict[str, str]
) -> None:
    parameters = tmp_path / 'parameters.yaml'
    wrong = {'/**/fake_hardware': {'ros__parameters': {'initial_position': [0.0]}}}
    parameters.write_text(yaml.safe_dump(wrong))
    out = () if file == 'bringup' else (f'out:={tmp_path / "out"}',)
    status, output = ros2_launch(file, f'params_file:={parameters}', *out)
    assert status == 1, output[-3000:]
    assert 'initial_position' in output
    assert 'Caught exception in launch (see debug for traceback): bridge: exit status 1' in output


def test_real_boards_are_of_the_given_urdf(renamed_urdf: Path, ros_domain: dict[str, str]) -> None:
    # The packaged configuration: the bridge must miss its joints there.
    status, output = ros2_launch('bringup', 'hardware:=spi', f'urdf:={renamed_urdf}')
    assert status == 1, output[-3000:]
    assert f'not configured: {renamed_urdf}: ' in output


@pytest.mark.parametrize(
    ('file', 'argument', 'choices'),
    [
        ('identification', 'controller:=computed_torque', "['none']"),
        ('moveit', 'controller:=gravity_compensation', "['computed_torque']"),
        ('bringup', 'rviz:=maybe', "['true', 'false']"),
    ],
)
def test_invalid_arguments_are_rejected_before_the_start(
    file: str, argument: str, choices: str, ros_domain: dict[str, str]
) -> None:
    status, output = ros2_launch(file, argument)
    assert status == 1, output[-3000:]
    assert f'not valid. Valid options are: {choices}' in output
    assert 'process started' not in output
