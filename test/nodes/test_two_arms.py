"""Two arms in one ROS domain with different prefixes: one tree of frames, no confusion."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import rclpy
from bridge_client import BridgeClient
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.ros.process.node_process import NodeProcess

SIDES, IMU = ('left', 'right'), '/drone/imu'  # the IMU of the left arm is outside its namespace
JOINTS = ('joint1', 'joint2', 'joint3', 'joint4')


class HeardArm:
    """Received messages of one arm."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.node = rclpy.create_node('client', namespace=f'/{name}')
        self.bridge = BridgeClient(self.node)
        self.urdf: list[str] = []
        self.wrenches: list[WrenchStamped] = []
        topic = topics.SET_POINT
        self._set_points = self.node.create_publisher(topic.type, topic.name, topic.offered)
        self._listen(topics.ROBOT_DESCRIPTION, self._on_urdf)
        self._listen(topics.BASE_WRENCH, self.wrenches.append)

    def links_and_joints(self) -> tuple[dict[str, str], set[str]]:
        """Return each link of the published URDF that hangs on a joint, and the joints."""
        self.bridge.wait_for(lambda: bool(self.urdf))
        joints = ET.fromstring(self.urdf[-1]).findall('joint')
        parents = {j.find('child').get('link'): j.find('parent').get('link') for j in joints}
        return parents, {joint.get('name') for joint in joints}

    @property
    def position(self) -> np.ndarray:
        """Newest joint positions [rad]."""
        return np.array(self.bridge.states[-1].position)

    def go(self, posture: np.ndarray) -> None:
        """Send the arm to a posture [rad]."""
        self.bridge.wait_for(lambda: self._set_points.get_subscription_count() > 0)
        names = list(self.bridge.states[-1].name)
        self._set_points.publish(JointState(name=names, position=posture.tolist()))

    def _listen(self, topic, callback) -> None:
        self.node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _on_urdf(self, message: String) -> None:
        self.urdf.append(message.data)


class NamespacedNodes:
    """Starts nodes in an arm's namespace."""

    def __init__(self, stack: ExitStack, logs: Path) -> None:
        self._stack, self._logs = stack, logs

    def log(self, side: str, name: str) -> str:
        return (self._logs / f'{side}_{name}.log').read_text()

    def start(self, side: str, name: str, prefix: str, **parameters: object) -> NodeProcess:
        # The launch files tell the bridge alone.
        clock = ('-r', '/clock:=clock') if name == 'fake_hardware' else ()
        imu = ('-r', f'imu:={IMU}') if side == 'left' else ()
        arguments = ('--ros-args', '-r', f'__ns:=/{side}', *clock, *imu, '--')
        given = {'tf_prefix': prefix, **parameters}
        log = self._logs / f'{side}_{name}.log'
        return self._stack.enter_context(NodeProcess(name, arguments, given, log=log))


@pytest.fixture
def nodes(ros_node: Node, tmp_path: Path) -> Iterator[NamespacedNodes]:
    with ExitStack() as stack:
        yield NamespacedNodes(stack, tmp_path)
    for log in sorted(tmp_path.glob('*.log')):  # shown if the test fails
        print(f'{log.name}:\n{log.read_text()}')


def test_two_arms_are_one_tree_and_each_moves_alone(nodes: NamespacedNodes, tmp_path: Path) -> None:
    saved = tmp_path / 'drawn.yaml'
    for side, profile in zip(SIDES, ('tilted', 'still'), strict=True):
        given = {'seed': 3, 'encoders': 'absolute', 'base_motion_profile': profile}
        nodes.start(side, 'fake_hardware', f'{side}_', **given)
    nodes.start('left', 'gravity_compensation', 'left_', base_motion='full')
    nodes.start('left', 'base_reaction', 'left_')
    nodes.start('right', 'gravity_compensation', 'left_')  # a mistake
    drawing = nodes.start('nowhere', 'excitation', 'left_', **drawn(tmp_path), save=saved)
    left, right = (HeardArm(side) for side in SIDES)

    (parents, joints), (others, other_joints) = left.links_and_joints(), right.links_and_joints()
    assert not parents.keys() & others.keys()
    assert not joints & other_joints
    # Each hangs on its own base, which is free to be fixed anywhere in the one tree.
    for tree, side in ((parents, left), (others, right)):
        assert set(tree.values()) - tree.keys() == {f'{side.name}_base_link'}

    for side in (left, right):
        side.bridge.wait_for_mode('idle')
        assert side.bridge.call('enable').success
    left.bridge.wait_for_mode('running')
    right.bridge.wait_for_mode('ready')
    for side in (left, right):
        side.bridge.wait_for(lambda side=side: bool(side.bridge.states and side.bridge.motors))
        names = [f'{side.name}_{joint}' for joint in JOINTS]
        assert list(side.bridge.states[-1].name) == names
        assert list(side.bridge.motors[-1].name) == names
    reported = left.bridge.diagnostics
    left.bridge.wait_for(lambda: any(x.get('base motion') == 'IMU' for x in reported.values()))
    names = {name for name, _ in left.node.get_topic_names_and_types()}
    assert {'/left/joint_states', '/left/joint_command', IMU} <= names
    assert not names & {'/joint_states', '/joint_command', '/left/imu', '/imu'}
    left.bridge.wait_for(lambda: bool(left.wrenches))
    assert left.wrenches[-1].header.frame_id == 'left_base_link'

    first, start = len(right.bridge.states), left.position
    left.go(start + 0.1)
    left.bridge.wait_for(lambda: np.abs(left.position - start).min() > 0.09)
    right.bridge.wait_for(lambda: len(right.bridge.states) > first)
    assert np.ptp([state.position for state in right.bridge.states[first:]], axis=0).max() < 0.01
    assert right.bridge.modes[-1] == 'ready'

    right.bridge.wait_for(lambda: 'tf_prefix' in right.bridge.messages['gravity_compensation'])
    told = nodes.log('right', 'gravity_compensation')
    assert re.search(r"joints \['left_joint1', .*missing.*same config, urdf and tf_prefix", told)

    # Files name joints and links as the arm's own files do, so that either arm can use them.
    assert drawing.wait(120.0) == 1
    assert 'no arm_mode received' in nodes.log('nowhere', 'excitation')
    assert TrajectoryFile.load(saved).joint_names == JOINTS


def drawn(tmp_path: Path) -> dict[str, object]:
    """Return parameters of a motion that is drawn, saved, and not played."""
    config = tmp_path / 'excitation.yaml'
    text = resource('config', 'excitation.yaml').read_text()
    config.write_text(text.replace('pairs: []', "pairs: ['link1 to link4']"))
    return {'excitation_config': config, 'wait_timeout': 0.1}
