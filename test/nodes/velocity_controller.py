"""A controller process for tests that kill it: it turns joint 1 for ever."""

import rclpy
from bridge_client import velocity_command

from aerarm_msgs_py.topics import JOINT_COMMAND, JOINT_STATES

if __name__ == '__main__':
    rclpy.init(args=[])
    node = rclpy.create_node('controller')
    commands = node.create_publisher(JOINT_COMMAND.type, JOINT_COMMAND.name, JOINT_COMMAND.qos)
    node.create_subscription(
        JOINT_STATES.type,
        JOINT_STATES.name,
        lambda state: commands.publish(velocity_command(state, [0.4, 0.0, 0.4, 0.4])),
        JOINT_STATES.qos,
    )
    rclpy.spin(node)
