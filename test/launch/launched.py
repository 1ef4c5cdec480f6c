"""Helpers of the tests with ROS's launch; without launch the tests skip with a reason."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
import unittest
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import pytest
import rclpy
import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from own_domain import own_domain

from aerarm_msgs_py.topics import Topic
from aerarm_ros.ros.process.node_process import ros_environment

NAMESPACE = '/launched'
PATIENCE = 60.0  # [s]
# For a launch file, also on a busy computer.
LAUNCH_TIMEOUT = 200.0  # [s]


def is_in_the_index(package: str) -> bool:
    """Return whether ROS's launch finds a package."""
    try:
        get_package_prefix(package)
    except (PackageNotFoundError, OSError):  # OSError: no environment is sourced
        return False
    return True


def _what_is_missing() -> str:
    for name in ('launch_testing', 'launch_ros'):
        if find_spec(name) is None:
            return (
                f'{name} is not installed: it comes with ROS 2 from apt, not from PyPI; process '
                'tests cover the nodes here'
            )
    if not is_in_the_index('aerarm_ros'):
        return 'aerarm_ros is not in the ament index: colcon build, source install/setup.bash'
    return ''


MISSING = _what_is_missing()
NO_COMMAND = MISSING or (
    '' if shutil.which('ros2') else 'there is no command ros2: source a ROS 2 environment'
)
needs_ros2_launch = pytest.mark.skipif(bool(NO_COMMAND), reason=NO_COMMAND)

if not MISSING:
    # Tests with launch_testing get no fixtures; the domain is released for the next user.
    os.environ.update(ros_environment(own_domain()))


def launch_test(name: str, values: Sequence[str]) -> Callable:
    """Mark generate_test_description, which has an argument of this name."""
    if MISSING:
        return lambda function: function
    import launch_testing

    parametrize = launch_testing.parametrize(name, values)
    return lambda function: pytest.mark.launch_test(parametrize(function))


def after_shutdown(case: type) -> type:
    """Mark a test case to run after all processes have ended."""
    if MISSING:
        return case
    import launch_testing

    return launch_testing.post_shutdown_test()(case)


def parameter_file(**nodes: dict) -> str:
    """Return the path of a new parameter file with the given values of nodes."""
    path = Path(tempfile.mkdtemp()) / 'parameters.yaml'
    content = {f'/**/{name}': {'ros__parameters': values} for name, values in nodes.items()}
    path.write_text(yaml.safe_dump(content))
    return str(path)


def description(file: str, arguments: Mapping[str, str], *actions: object, **context: object):
    """Return a launch file of this package, enabled in a test namespace, for a test."""
    from launch import LaunchDescription
    from launch.actions import IncludeLaunchDescription
    from launch.substitutions import PathJoinSubstitution
    from launch_ros.substitutions import FindPackageShare
    from launch_testing.actions import ReadyToTest

    path = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', f'{file}.launch.py'])
    given = {'enable': 'true', 'namespace': NAMESPACE, **arguments}
    include = IncludeLaunchDescription(path, launch_arguments=given.items())
    return LaunchDescription([include, *actions, ReadyToTest()]), context


@unittest.skipIf(MISSING, MISSING)
class LaunchedTestCase(unittest.TestCase):
    """Test case of processes that launch has started."""

    def assert_clean_end(self, proc_info, allowable: Sequence[int] = (0,)) -> None:
        """Assert the exit codes of this package's processes only."""
        from launch_testing.asserts import assertExitCodes

        nodes = [info for info in proc_info if '/lib/aerarm_ros/' in info.cmd[0]]
        # `arm` may be interrupted while it waits.
        ours = [info for info in nodes if not info.cmd[0].endswith('/arm')]
        self.assertTrue(ours)
        for info in ours:
            assertExitCodes(proc_info, allowable, process=info.action)


class ListeningTestCase(LaunchedTestCase):
    """Test case with a node that stores the messages of every subscribed topic."""

    def setUp(self):
        rclpy.init(args=[])
        self.node = rclpy.create_node('test', namespace=NAMESPACE)
        self.received: dict[str, list] = {}

    def tearDown(self):
        self.node.destroy_node()
        rclpy.shutdown()

    def listen(self, *topics: Topic):
        for topic in topics:
            messages = self.received.setdefault(topic.name, [])
            self.node.create_subscription(topic.type, topic.name, messages.append, topic.qos)

    def newest(self, topic: Topic):
        """Return the last message of a subscribed topic, or None."""
        messages = self.received[topic.name]
        return messages[-1] if messages else None

    def until_heard(self, *topics: Topic):
        """Wait until every subscribed topic has a message."""
        self.listen(*topics)
        self.until(lambda: all(self.received[topic.name] for topic in topics))

    def until(self, condition):
        """Wait for a condition; fail after `PATIENCE` with the topics received."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            received = sorted(name for name, messages in self.received.items() if messages)
            self.assertLess(time.monotonic(), deadline, f'received only {received}')
            rclpy.spin_once(self.node, timeout_sec=0.1)


def ros2_launch(file: str, *arguments: str, timeout: float = LAUNCH_TIMEOUT) -> tuple[int, str]:
    """Run a launch file that ends automatically; return its exit status and output."""
    process = subprocess.Popen(
        ['ros2', 'launch', 'aerarm_ros', f'{file}.launch.py', *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        output, _ = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)  # launch ends its processes too
        output, _ = process.communicate()
        pytest.fail(f'{file} has not ended in {timeout:.0f} s:\n{output[-3000:]}')
    return process.returncode, output
