"""`arm calibrate --dry-run`: options, and joint positions by name."""

import argparse

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from measured_arm import ROBOT
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.posture_choice import faces_camera
from aerarm_ros.nodes.arm import make_parser
from aerarm_ros.ros.programs.calibrate_arm import CalibrateArm
from aerarm_ros.ros.requests.arm_client import ArmClientError

CAMERA = (0.9, -0.9, 0.5)


def options(*arguments: str) -> argparse.Namespace:
    return make_parser().parse_args(['calibrate', '--dry-run', *arguments])


def test_a_marker_normal_needs_a_camera(ros_node: Node) -> None:
    arm = CalibrateArm(ros_node, options('--marker-normal', '0', '0', '1'))
    with pytest.raises(ArmClientError, match='--marker-normal needs the position of the camera'):
        arm.run()


def test_postures_start_at_the_named_joint_positions(
    ros_node: Node, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = topics.JOINT_STATES
    states = ros_node.create_publisher(topic.type, topic.name, topic.qos)
    markers = ros_node.create_publisher(PointStamped, 'mocap/tip', 10)
    message = JointState(velocity=ROBOT.n * [0.0])

    def publish() -> None:
        states.publish(message)
        markers.publish(PointStamped())

    timer = ros_node.create_timer(0.05, publish)
    found = []
    start = dict(zip(ROBOT.joint_names, (0.2, 1.3, -0.3, 0.4), strict=True))
    for names in (ROBOT.joint_names, ROBOT.joint_names[::-1]):
        message.name = list(names)
        message.position = [start[name] for name in names]
        given = options('--postures', '4', '--timeout', '20', '--camera', *map(str, CAMERA))
        CalibrateArm(ros_node, given).run()
        lines = capsys.readouterr().out.splitlines()
        found.append(np.array([[float(x) for x in line.split()] for line in lines]))
    ros_node.destroy_timer(timer)
    np.testing.assert_array_equal(found[0], found[1])
    geometry = ArmGeometry(ROBOT, ROBOT.link_names[-1])
    is_visible = faces_camera(geometry, np.array(CAMERA), np.array([0.0, 0.0, 1.0]))
    assert all(map(is_visible, found[0]))
