"""bringup.launch.py with every controller, by launch_testing."""

from launched import LaunchedTestCase, ListeningTestCase, after_shutdown, description, launch_test

from aerarm_msgs_py import topics
from aerarm_ros.executables import controllers


@launch_test('controller', ['none', *controllers()])
def generate_test_description(controller):
    return description('bringup', {'controller': controller}, controller=controller)


class TestBringup(ListeningTestCase):
    def test_the_arm_is_up(self, controller):
        self.until_heard(topics.JOINT_STATES, topics.ARM_MODE, topics.DIAGNOSTICS)
        wanted = 'ready' if controller == 'none' else 'running'
        self.until(lambda: self.newest(topics.ARM_MODE).data == wanted)
        names = list(self.newest(topics.JOINT_STATES).name)
        self.assertEqual(names, ['joint1', 'joint2', 'joint3', 'joint4'])

    def test_the_urdf_is_latched(self):
        self.until_heard(topics.ROBOT_DESCRIPTION)
        self.assertIn('<robot', self.newest(topics.ROBOT_DESCRIPTION).data)


@after_shutdown
class TestShutdown(LaunchedTestCase):
    def test_everything_ends_cleanly(self, proc_info):
        self.assert_clean_end(proc_info)
