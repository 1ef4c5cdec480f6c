"""The tool's path as a process, fed by this one."""

from pathlib import Path as FilePath

import numpy as np
import rclpy
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.topics import TOOL_PATH
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.nodes.node_process import NodeProcess

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
        for _ in range(3000):
            if paths and len(paths[-1].poses) > 10:
                break
            if states.get_subscription_count():
                q[1] += STEP * 0.1
                states.publish(codec.pack(ros_node.get_clock().now().nanoseconds, q))
            rclpy.spin_once(ros_node, timeout_sec=0.01)
    path = paths[-1]
    assert path.header.frame_id == 'base_link'
    points = np.array(
        [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in path.poses]
    )
    # All on the circle about joint 2 that the tool moves on, in order.
    reach = np.linalg.norm(Kinematics(robot, 'tool0').position(q) - [0.0, 0.0, 0.167])
    np.testing.assert_allclose(np.linalg.norm(points - [0.0, 0.0, 0.167], axis=1), reach, atol=1e-9)
    assert np.all(np.diff(points[:, 2]) > 0.0)
