"""Every node that needs no controller, beside the arm on fake hardware, by launch_testing."""

import tempfile
import unittest
from pathlib import Path

import pytest
from launched import NAMESPACE, ListeningTestCase, assert_clean_end, bringup

# isort: split
import launch_testing
from launch import LaunchDescription
from launch_ros.actions import Node
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import EXIT_OK

from aerarm_msgs_py import topics

# The parameters to start with, and what is heard of a node that works.
NODES = {
    'base_reaction': ({}, topics.BASE_WRENCH),
    'excitation': ({}, None),  # waits for somebody to enable the arm
    'motor_bench': ({}, None),  # so does this
    'hardware_bridge': ({'autostart': False}, topics.DIAGNOSTICS),
    'recorder': ({}, topics.RECORDER_STATUS),
    'tool_path': ({}, topics.TOOL_PATH),
    'view': ({'port': 8123}, None),
}


@pytest.mark.launch_test
@launch_testing.parametrize('executable', list(NODES))
def generate_test_description(executable):
    parameters, _ = NODES[executable]
    if executable == 'recorder':
        parameters = {'bag': str(Path(tempfile.mkdtemp()) / 'bag')}
    node = Node(
        package='aerarm_ros',
        executable=executable,
        namespace=NAMESPACE,
        parameters=[parameters],
        output='screen',
    )
    context = {'executable': executable, 'started': node}
    return LaunchDescription([bringup(enable='false'), node, ReadyToTest()]), context


class TestNode(ListeningTestCase):
    def test_it_is_found_and_heard(self, executable, started, proc_info):
        self.until(lambda: executable in self.node.get_node_names())
        wanted = [topics.JOINT_STATES, *filter(None, [NODES[executable][1]])]
        self.listen(*wanted)
        self.until(lambda: len(self.received) == len(wanted))
        self.assertNotIn(started, proc_info)  # it has not ended


@launch_testing.post_shutdown_test()
class TestShutdown(unittest.TestCase):
    def test_everything_ends_cleanly(self, proc_info):
        # 130 is what says that a motion was not played.
        assert_clean_end(self, proc_info, (EXIT_OK, 130))
