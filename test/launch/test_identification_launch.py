"""identification.launch.py from enabling the motors to the report, by launch_testing."""

import json
import tempfile
import unittest
from pathlib import Path

import pytest

WHERE = 'it comes with ROS 2 from apt, not from PyPI: make demo covers the path here'
pytest.importorskip('launch_testing', reason=f'launch_testing is not installed: {WHERE}')
pytest.importorskip('launch_ros', reason=f'launch_ros is not installed: {WHERE}')

import launch_testing  # noqa: E402
from ament_index_python.packages import PackageNotFoundError, get_package_prefix  # noqa: E402
from launch import LaunchDescription  # noqa: E402
from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.substitutions import PathJoinSubstitution  # noqa: E402
from launch_ros.substitutions import FindPackageShare  # noqa: E402
from launch_testing.actions import ReadyToTest  # noqa: E402

try:
    get_package_prefix('aerarm_ros')
except PackageNotFoundError:
    pytest.skip(
        'aerarm_ros is not in the ament index: colcon build, source install/setup.bash',
        allow_module_level=True,
    )

OUT = Path(tempfile.mkdtemp()) / 'run'
PATIENCE = 150.0


@pytest.mark.launch_test
def generate_test_description():
    path = [FindPackageShare('aerarm_ros'), 'launch', 'identification.launch.py']
    arguments = {'out': str(OUT), 'periods': '1', 'namespace': '/launched'}
    included = IncludeLaunchDescription(
        PathJoinSubstitution(path), launch_arguments=arguments.items()
    )
    return LaunchDescription([included, ReadyToTest()])


class TestIdentification(unittest.TestCase):
    def test_the_identifier_is_reached(self, proc_output):
        proc_output.assertWaitFor('Report: ', timeout=PATIENCE)


@launch_testing.post_shutdown_test()
class TestResult(unittest.TestCase):
    def test_the_model_is_physical(self):
        summary = json.loads((OUT / 'result' / 'summary.json').read_text())
        self.assertTrue(summary['solvers']['sdp']['physically_consistent'])
