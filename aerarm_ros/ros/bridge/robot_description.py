"""The arm's URDF on a topic, for RViz, Foxglove and whoever else draws it."""

from __future__ import annotations

from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics


class RobotDescription:
    """Publishes a URDF once; whoever subscribes later still gets it.

    Parameters
    ----------
    node
        Owner of the publisher.
    urdf_text
        The URDF itself, for example `Robot.urdf_text`.
    """

    def __init__(self, node: Node, urdf_text: str) -> None:
        self._node = node
        topic = topics.ROBOT_DESCRIPTION
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        self._publisher.publish(String(data=urdf_text))

    def destroy(self) -> None:
        """Destroy the publisher; the text is gone for later subscribers."""
        self._node.destroy_publisher(self._publisher)
