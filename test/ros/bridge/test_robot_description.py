import rclpy
from rclpy.node import Node

from aerarm_msgs_py.topics import ROBOT_DESCRIPTION
from aerarm_ros.ros.bridge.hardware_bridge import RobotDescription


def test_late_subscribers_receive_the_urdf(ros_node: Node) -> None:
    RobotDescription(ros_node, '<robot name="arm"/>')
    received: list[str] = []
    late = rclpy.create_node('late')
    topic = ROBOT_DESCRIPTION
    late.create_subscription(
        topic.type, topic.name, lambda message: received.append(message.data), topic.qos
    )
    for _ in range(100):
        if received:
            break
        rclpy.spin_once(late, timeout_sec=0.1)
    late.destroy_node()
    assert received == ['<robot name="arm"/>']
