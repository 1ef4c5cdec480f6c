"""The tool's path as a process, with states from the test."""

import time
from pathlib import Path as FilePath

import numpy as np
import yaml
from quick_spinning import spin_once, spin_until
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.topics import TOOL_PATH
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.process.node_process import NodeProcess

STEP = 0.02


def test_follows_the_tool(ros_node: Node, tmp_path: FilePath) -> None:
    robot = load_robot()
    codec = JointStateCdr(robot.joint_names)
    states = ros_node.create_publisher(
        topics.JOINT_STATES.type, topics.JOINT_STATES.name, topics.JOINT_STATES.qos
    )
    paths = []
    ros_node.create_subscription(TOOL_PATH.type, TOOL_PATH.name, paths.append, TOOL_PATH.qos)
    q = np.array([0.0, 0.5, 0.0, 0.0])
    with NodeProcess('tool_path', parameters={'rate': 50.0}, log=tmp_path / 'log'):
        deadline = time.monotonic() + 60.0
        while not (paths and len(paths[-1].poses) > 10):
            assert time.monotonic() < deadline
            if states.get_subscription_count():
                # Before it is heard it stays: too far from there the tool comes down again.
                q[1] += STEP * 0.1 if paths else 0.0
                states.publish(codec.pack(ros_node.get_clock().now().nanoseconds, q))
            spin_once(ros_node, 0.01)
        # Who comes when the arm rests sees the path as well.
        late = []
        ros_node.create_subscription(TOOL_PATH.type, TOOL_PATH.name, late.append, TOOL_PATH.qos)
        assert spin_until(ros_node, lambda: late, 60.0)
        assert len(late[-1].poses) >= 10
    path = paths[-1]
    assert path.header.frame_id == 'base_link'
    points = np.array(
        [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in path.poses]
    )
    # All on the circle about joint 2 that the tool moves on, in order.
    reach = np.linalg.norm(Kinematics(robot, 'tool0').position(q) - [0.0, 0.0, 0.167])
    np.testing.assert_allclose(np.linalg.norm(points - [0.0, 0.0, 0.167], axis=1), reach, atol=1e-9)
    assert np.all(np.diff(points[:, 2]) > 0.0)


def test_rviz_receives_the_path_that_was_published_earlier() -> None:
    displays = yaml.safe_load(resource('rviz', 'aerarm.rviz').read_text())
    (path,) = [
        display['Topic']
        for display in displays['Visualization Manager']['Displays']
        if display['Class'] == 'rviz_default_plugins/Path'
    ]
    assert path['Value'] == TOOL_PATH.name
    assert TOOL_PATH.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert path['Durability Policy'] == 'Transient Local'
