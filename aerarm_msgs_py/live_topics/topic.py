"""One topic: its name, message type and quality of service."""

from dataclasses import dataclass
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy


@dataclass(frozen=True)
class Topic:
    """A topic as every node of the suite knows it.

    Attributes
    ----------
    name
        Relative name, so that a namespace moves the whole arm; `/diagnostics` is absolute
        because the tools that read it expect it there.
    type
        Message class.
    qos
        Profile of the suite's subscriptions.
    """

    name: str
    type: Any
    qos: QoSProfile

    def queued(self, depth: int) -> 'Topic':
        """Return the topic for who wants every message, and may be late by so many."""
        qos = QoSProfile(
            depth=depth, reliability=self.qos.reliability, durability=self.qos.durability
        )
        return Topic(self.name, self.type, qos)

    @property
    def offered(self) -> QoSProfile:
        """Profile of the suite's publishers: that of its subscriptions, but always reliable.

        A reliable publisher reaches subscriptions of either kind, a best-effort one only its own.
        With a last history it never waits for a slow subscriber: what that has not taken is
        replaced. A best-effort subscription is served as before, and costs no more.
        """
        return QoSProfile(
            history=self.qos.history,
            depth=self.qos.depth,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=self.qos.durability,
        )

    @property
    def type_name(self) -> str:
        """Type as ROS writes it, for example 'sensor_msgs/msg/JointState'."""
        package, folder, *_ = self.type.__module__.split('.')
        return f'{package}/{folder}/{self.type.__name__}'
