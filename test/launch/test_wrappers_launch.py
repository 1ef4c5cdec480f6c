"""Launch files that extend the bring-up, and its page, by launch_testing."""

import socket
from importlib.util import find_spec

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
from aerarm_ros.description.resources import resource

HAS_PX4 = find_spec('px4_msgs') is not None
WITH_DRONE = {'gravity_compensation', 'base_reaction'}
# The launch file, the nodes beside the bridge that it brings, and a topic of theirs.
CASES = {
    'gravity_compensation': ('gravity_compensation', {'gravity_compensation'}, None),
    'computed_torque': ('computed_torque', {'computed_torque'}, None),
    'drone': ('drone', WITH_DRONE, topics.BASE_WRENCH),
    'flying': ('drone', {*WITH_DRONE, 'flight_control'}, topics.ROTOR_COMMAND),
    # Without px4_msgs it is refused, as test_launch_requirements.py has it.
    **({'px4': ('drone', WITH_DRONE, topics.BASE_WRENCH)} if HAS_PX4 else {}),
    'view': ('bringup', {'view', 'gravity_compensation'}, None),
}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


@launch_test('case', list(CASES))
def generate_test_description(case):
    arguments, port = {}, free_port()
    if case == 'drone':
        file = parameter_file(fake_hardware={'base_motion_profile': 'tilted'})
        arguments = {'imu_topic': '/drone/imu', 'base_motion': 'full', 'params_file': file}
    if case == 'flying':
        arguments = {'drone_file': str(resource('config', 'drone.yaml'))}
    if case == 'px4':
        arguments = {'autopilot': 'px4', 'base_motion': 'full'}
    if case == 'view':
        file = parameter_file(view={'port': port})
        arguments = {'view': 'true', 'controller': 'gravity_compensation', 'params_file': file}
    return description(CASES[case][0], arguments, case=case, port=port)


class TestWrapper(ListeningTestCase):
    def test_the_arm_runs_with_all_optional_nodes(self, case):
        _, nodes, topic = CASES[case]
        self.until_heard(topics.ARM_MODE, *filter(None, [topic]))
        self.until(lambda: self.newest(topics.ARM_MODE).data == 'running')
        self.until(lambda: nodes <= set(self.node.get_node_names()))

    def test_the_page_is_served(self, case, port):
        self.until(lambda: case != 'view' or is_served(port))

    def test_the_controller_uses_the_imu_as_requested(self, case):
        # The controller and base_reaction.
        if case == 'drone':
            self.until(lambda: self.node.count_subscribers('/drone/imu') == 2)
        if case == 'px4':
            self.until(lambda: self.node.count_subscribers(f'{NAMESPACE}/imu') == 2)
            self.until(lambda: self.node.count_publishers(f'{NAMESPACE}/imu') == 1)


def is_served(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(('127.0.0.1', port)) == 0


@after_shutdown
class TestShutdown(LaunchedTestCase):
    def test_everything_ends_cleanly(self, proc_info):
        self.assert_clean_end(proc_info)
