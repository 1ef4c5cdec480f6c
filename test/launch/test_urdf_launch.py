"""Which URDF reaches whom: an arm of one's own, an identified model, and real boards."""

import re
import tempfile
import unittest
from pathlib import Path

from launched import (
    NAMESPACE,
    PATIENCE,
    LaunchedTestCase,
    ListeningTestCase,
    after_shutdown,
    description,
    is_in_the_index,
    launch_test,
)

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource

URDF, CONFIG = resource('urdf', 'aerarm.urdf'), resource('config', 'aerarm.yaml')
AXES = ['axis1', 'axis2', 'axis3', 'axis4']


def renamed(path: Path) -> str:
    """Return a copy of a file in which the arm's joints have other names."""
    copy = Path(tempfile.mkdtemp()) / f'my_{path.name}'
    copy.write_text(re.sub(r'\bjoint([1-4])\b', r'axis\1', path.read_text()))
    return str(copy)


def identified() -> str:
    """Return a copy of the packaged URDF in which every link has another mass."""
    copy = Path(tempfile.mkdtemp()) / 'identified.urdf'
    text = URDF.read_text()
    copy.write_text(text.replace('<mass value="0.', '<mass value="0.1'))
    assert copy.read_text() != text
    return str(copy)


@launch_test('case', ['own_arm', 'identified', 'real_boards'])
def generate_test_description(case):
    arm = renamed(URDF)
    arguments = {
        'own_arm': {'config': renamed(CONFIG), 'urdf': arm, 'plant_urdf': arm},
        'identified': {'urdf': identified()},
        # The packaged configuration: the bridge must miss its joints in the given URDF.
        'real_boards': {'hardware': 'spi', 'urdf': arm, 'enable': 'false'},
    }[case]
    running = {'controller': 'none' if case == 'real_boards' else 'gravity_compensation'}
    return description('bringup', {**arguments, **running}, case=case, plant=arm)


class TestUrdf(ListeningTestCase):
    def test_the_arm_that_moves_is_the_one_described(self, case, plant, proc_info, proc_output):
        if case == 'real_boards':
            proc_info.assertWaitForShutdown('hardware_bridge', timeout=PATIENCE)
            proc_output.assertWaitFor(f'not configured: {plant}: ', timeout=PATIENCE)
            return
        self.until_heard(topics.ARM_MODE, topics.JOINT_STATES, topics.ROBOT_DESCRIPTION)
        self.until(lambda: self.newest(topics.ARM_MODE).data == 'running')
        names = list(self.newest(topics.JOINT_STATES).name)
        self.assertEqual(names == AXES, case == 'own_arm')
        shown = self.newest(topics.ROBOT_DESCRIPTION).data
        self.assertEqual(shown, (Path(plant) if case == 'own_arm' else URDF).read_text())
        name = f'{NAMESPACE}/{topics.ROBOT_DESCRIPTION.name}'
        self.assertEqual(self.node.count_publishers(name), 1)

    @unittest.skipUnless(
        is_in_the_index('robot_state_publisher'),
        'robot_state_publisher is not installed: it comes with ROS 2 from apt',
    )
    def test_a_namespace_has_frames_of_its_own(self):
        self.until(lambda: self.node.count_publishers(f'{NAMESPACE}/tf') == 1)
        self.assertEqual(self.node.count_publishers('/tf'), 0)


@after_shutdown
class TestShutdown(LaunchedTestCase):
    def test_everything_ends_cleanly(self, case, proc_info):
        self.assert_clean_end(proc_info, (0, 1) if case == 'real_boards' else (0,))
