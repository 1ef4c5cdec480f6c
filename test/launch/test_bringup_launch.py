"""bringup.launch.py with every controller, by launch_testing."""

import time
import unittest

import pytest

WHERE = 'it comes with ROS 2 from apt, not from PyPI: process tests cover the nodes here'
pytest.importorskip('launch_testing', reason=f'launch_testing is not installed: {WHERE}')
pytest.importorskip('launch_ros', reason=f'launch_ros is not installed: {WHERE}')

import launch_testing  # noqa: E402
import rclpy  # noqa: E402
from ament_index_python.packages import PackageNotFoundError, get_package_prefix  # noqa: E402
from launch import LaunchDescription  # noqa: E402
from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.substitutions import PathJoinSubstitution  # noqa: E402
from launch_ros.substitutions import FindPackageShare  # noqa: E402
from launch_testing.actions import ReadyToTest  # noqa: E402
from launch_testing.asserts import EXIT_OK, assertExitCodes  # noqa: E402

from aerarm_msgs_py import topics  # noqa: E402
from aerarm_msgs_py.topics import ROBOT_DESCRIPTION  # noqa: E402

try:
    get_package_prefix('aerarm_ros')
except PackageNotFoundError:
    pytest.skip(
        'aerarm_ros is not in the ament index: colcon build, source install/setup.bash',
        allow_module_level=True,
    )

NAMESPACE = '/launched'
CONTROLLERS = ['none', 'gravity_compensation', 'computed_torque', 'impedance_control']
PATIENCE = 60.0


@pytest.mark.launch_test
@launch_testing.parametrize('controller', CONTROLLERS)
def generate_test_description(controller):
    bringup = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', 'bringup.launch.py'])
    arguments = {'enable': 'true', 'controller': controller, 'namespace': NAMESPACE}
    included = IncludeLaunchDescription(bringup, launch_arguments=arguments.items())
    return LaunchDescription([included, ReadyToTest()]), {'controller': controller}


class TestBringup(unittest.TestCase):
    def setUp(self):
        rclpy.init(args=[])
        self.node = rclpy.create_node('test', namespace=NAMESPACE)
        self.received = {}

    def tearDown(self):
        self.node.destroy_node()
        rclpy.shutdown()

    def listen(self, topic):
        def keep(message):
            self.received[topic.name] = message

        return self.node.create_subscription(topic.type, topic.name, keep, topic.qos)

    def until(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self.assertLess(time.monotonic(), deadline, f'only {sorted(self.received)}')
            rclpy.spin_once(self.node, timeout_sec=0.1)

    def test_the_arm_is_up(self, controller):
        for topic in (topics.JOINT_STATES, topics.ARM_MODE, topics.DIAGNOSTICS):
            self.listen(topic)
        wanted = 'ready' if controller == 'none' else 'running'
        mode = topics.ARM_MODE.name
        self.until(lambda: mode in self.received and self.received[mode].data == wanted)
        self.until(lambda: len(self.received) == 3)
        names = list(self.received[topics.JOINT_STATES.name].name)
        self.assertEqual(names, ['joint1', 'joint2', 'joint3', 'joint4'])

    def test_the_urdf_is_latched(self):
        self.listen(ROBOT_DESCRIPTION)
        self.until(lambda: ROBOT_DESCRIPTION.name in self.received)
        self.assertIn('<robot', self.received[ROBOT_DESCRIPTION.name].data)


@launch_testing.post_shutdown_test()
class TestShutdown(unittest.TestCase):
    def test_everything_ends_cleanly(self, proc_info):
        # Others' nodes are not ours to judge, and arm may be interrupted in what it waits for.
        nodes = [info for info in proc_info if '/lib/aerarm_ros/' in info.cmd[0]]
        ours = [info for info in nodes if not info.cmd[0].endswith('/arm')]
        self.assertTrue(ours)
        for info in ours:
            assertExitCodes(proc_info, [EXIT_OK], process=info.action)
