"""bringup.launch.py with every controller, by launch_testing."""

import unittest

import pytest
from launched import ListeningTestCase, assert_clean_end, bringup

# isort: split
import launch_testing
from launch import LaunchDescription
from launch_testing.actions import ReadyToTest

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import ROBOT_DESCRIPTION

CONTROLLERS = [
    'none',
    'gravity_compensation',
    'computed_torque',
    'impedance_control',
    'kinematic_control',
]


@pytest.mark.launch_test
@launch_testing.parametrize('controller', CONTROLLERS)
def generate_test_description(controller):
    return LaunchDescription([bringup(controller=controller), ReadyToTest()]), {
        'controller': controller
    }


class TestBringup(ListeningTestCase):
    def test_the_arm_is_up(self, controller):
        self.listen(topics.JOINT_STATES, topics.ARM_MODE, topics.DIAGNOSTICS)
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
        assert_clean_end(self, proc_info)
