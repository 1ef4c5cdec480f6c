import rclpy
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py.topics import ROBOT_DESCRIPTION


def test_late_subscribers_receive_the_urdf(ros_node: Node) -> None:
    topic = ROBOT_DESCRIPTION
    publisher = ros_node.create_publisher(topic.type, topic.name, topic.offered)
    publisher.publish(String(data='<robot name="arm"/>'))
    received: list[str] = []
    late = rclpy.create_node('late')
    late.create_subscription(
        topic.type, topic.name, lambda message: received.append(message.data), topic.qos
    )
    for _ in range(100):
        if received:
            break
        rclpy.spin_once(late, timeout_sec=0.1)
    late.destroy_node()
    assert received == ['<robot name="arm"/>']
