"""Every node without a controller, with the arm on fake hardware, by launch_testing."""

import tempfile
from importlib.util import find_spec
from pathlib import Path

from launched import (
    NAMESPACE,
    LaunchedTestCase,
    ListeningTestCase,
    after_shutdown,
    description,
    launch_test,
    parameter_file,
)

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
    # Without px4_msgs it says so and ends, as test_px4_imu.py has it.
    **({'px4_imu': ({}, None)} if find_spec('px4_msgs') else {}),
}


@launch_test('executable', list(NODES))
def generate_test_description(executable):
    from launch_ros.actions import Node

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
    # No motor is switched on, so nobody homes the arm: its angles are known from the start.
    known = {'fake_hardware': {'encoders': 'absolute'}}
    arguments = {'enable': 'false', 'params_file': parameter_file(**known)}
    return description('bringup', arguments, node, executable=executable, started=node)


class TestNode(ListeningTestCase):
    def test_the_node_is_discovered_and_received(self, executable, started, proc_info):
        self.until(lambda: executable in self.node.get_node_names())
        self.until_heard(topics.JOINT_STATES, *filter(None, [NODES[executable][1]]))
        self.assertNotIn(started, proc_info)  # it has not ended


@after_shutdown
class TestShutdown(LaunchedTestCase):
    def test_everything_ends_cleanly(self, proc_info):
        # 130 is what says that a motion was not played.
        self.assert_clean_end(proc_info, (0, 130))
