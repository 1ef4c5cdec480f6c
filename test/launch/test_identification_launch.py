"""identification.launch.py from enabling the motors to the report, by ros2 launch.

It ends by itself, which launch_testing takes for a failure; so it runs as a command here.
"""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip(
    'launch_ros',
    reason='launch_ros is not installed: it comes with ROS 2 from apt, not from PyPI; make demo '
    'covers the path here',
)
if shutil.which('ros2') is None:
    pytest.skip('there is no command ros2: source a ROS 2 environment', allow_module_level=True)
if subprocess.run(['ros2', 'pkg', 'prefix', 'aerarm_ros'], capture_output=True).returncode:
    pytest.skip(
        'aerarm_ros is not built: colcon build, source install/setup.bash', allow_module_level=True
    )


def test_a_model_comes_out(tmp_path: Path, ros_domain: dict[str, str]) -> None:
    out = tmp_path / 'run'
    command = ['ros2', 'launch', 'aerarm_ros', 'identification.launch.py']
    command += [f'out:={out}', 'periods:=1', 'namespace:=/launched']
    done = subprocess.run(command, capture_output=True, text=True, timeout=200.0)
    assert done.returncode == 0, done.stdout[-3000:]
    summary = json.loads((out / 'result' / 'summary.json').read_text())
    assert summary['solvers']['sdp']['physically_consistent']
