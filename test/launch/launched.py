"""What the tests by launch_testing share; importing it skips them where that is not installed."""

import time
import unittest

import pytest

WHERE = 'it comes with ROS 2 from apt, not from PyPI: process tests cover the nodes here'
pytest.importorskip('launch_testing', reason=f'launch_testing is not installed: {WHERE}')
pytest.importorskip('launch_ros', reason=f'launch_ros is not installed: {WHERE}')

import rclpy  # noqa: E402
from ament_index_python.packages import PackageNotFoundError, get_package_prefix  # noqa: E402
from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.substitutions import PathJoinSubstitution  # noqa: E402
from launch_ros.substitutions import FindPackageShare  # noqa: E402
from launch_testing.asserts import EXIT_OK, assertExitCodes  # noqa: E402

from aerarm_msgs_py.topic import Topic  # noqa: E402

try:
    get_package_prefix('aerarm_ros')
except PackageNotFoundError:
    pytest.skip(
        'aerarm_ros is not in the ament index: colcon build, source install/setup.bash',
        allow_module_level=True,
    )

NAMESPACE = '/launched'
PATIENCE = 60.0  # [s]


def bringup(**arguments: str) -> IncludeLaunchDescription:
    """Return the bring-up on fake hardware, enabled, in a namespace of the tests."""
    path = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', 'bringup.launch.py'])
    arguments = {'enable': 'true', 'namespace': NAMESPACE, **arguments}
    return IncludeLaunchDescription(path, launch_arguments=arguments.items())


class ListeningTestCase(unittest.TestCase):
    """Has a node, and keeps the last message of every topic that it listens to."""

    def setUp(self):
        rclpy.init(args=[])
        self.node = rclpy.create_node('test', namespace=NAMESPACE)
        self.received = {}

    def tearDown(self):
        self.node.destroy_node()
        rclpy.shutdown()

    def listen(self, *topics: Topic):
        for topic in topics:
            self.node.create_subscription(topic.type, topic.name, self._keep(topic.name), topic.qos)

    def until(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self.assertLess(time.monotonic(), deadline, f'only {sorted(self.received)}')
            rclpy.spin_once(self.node, timeout_sec=0.1)

    def _keep(self, name):
        def keep(message):
            self.received[name] = message

        return keep


def assert_clean_end(case, proc_info, allowable=(EXIT_OK,)):
    """Assert the exit codes of this package's processes; others' nodes are not ours to judge."""
    nodes = [info for info in proc_info if '/lib/aerarm_ros/' in info.cmd[0]]
    # arm may be interrupted in what it waits for.
    ours = [info for info in nodes if not info.cmd[0].endswith('/arm')]
    case.assertTrue(ours)
    for info in ours:
        assertExitCodes(proc_info, allowable, process=info.action)
