"""The URDF of each node: the user's arm, an identified model, and real boards."""

import re
import tempfile
import unittest
from pathlib import Path

from launched import (
    NAMESPACE,
    LaunchedTestCase,
    ListeningTestCase,
    after_shutdown,
    description,
    is_in_the_index,
    launch_test,
)

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource
from aerarm_ros.description.urdf_document import UrdfDocument

URDF, CONFIG = resource('urdf', 'aerarm.urdf'), resource('config', 'aerarm.yaml')
# The names of the joints, by what the arm is.
JOINTS = {
    'own_arm': ['axis1', 'axis2', 'axis3', 'axis4'],
    'identified': ['joint1', 'joint2', 'joint3', 'joint4'],
    'prefixed': ['left_joint1', 'left_joint2', 'left_joint3', 'left_joint4'],
}


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


@launch_test('case', list(JOINTS))
def generate_test_description(case):
    arm = renamed(URDF)
    arguments = {
        'own_arm': {'config': renamed(CONFIG), 'urdf': arm, 'plant_urdf': arm},
        'identified': {'urdf': identified()},
        'prefixed': {'tf_prefix': 'left_'},
    }[case]
    arguments['controller'] = 'gravity_compensation'
    return description('bringup', arguments, case=case, plant=arm)


class TestUrdf(ListeningTestCase):
    def test_the_arm_that_moves_is_the_one_described(self, case, plant):
        self.until_heard(topics.ARM_MODE, topics.JOINT_STATES, topics.ROBOT_DESCRIPTION)
        self.until(lambda: self.newest(topics.ARM_MODE).data == 'running')
        self.assertEqual(list(self.newest(topics.JOINT_STATES).name), JOINTS[case])
        described = UrdfDocument(self.newest(topics.ROBOT_DESCRIPTION).data)
        drawn = UrdfDocument((Path(plant) if case == 'own_arm' else URDF).read_text())
        if case == 'prefixed':
            drawn = UrdfDocument(drawn.prefixed_text('left_'))
        self.assertEqual(described.revolute_text(), drawn.revolute_text())
        name = f'{NAMESPACE}/{topics.ROBOT_DESCRIPTION.name}'
        self.assertEqual(self.node.count_publishers(name), 1)

    @unittest.skipUnless(
        is_in_the_index('robot_state_publisher'),
        'robot_state_publisher is not installed: it comes with ROS 2 from apt',
    )
    def test_a_namespace_has_frames_of_its_own_and_a_prefix_the_common_ones(self, case):
        own = case != 'prefixed'
        self.until(lambda: self.node.count_publishers(f'{NAMESPACE}/tf') == own)
        self.until(lambda: self.node.count_publishers('/tf') == (not own))


@after_shutdown
class TestShutdown(LaunchedTestCase):
    def test_everything_ends_cleanly(self, proc_info):
        self.assert_clean_end(proc_info)
