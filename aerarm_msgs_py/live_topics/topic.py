"""One topic: its name, message type and quality of service."""

from dataclasses import dataclass
from typing import Any

from rclpy.qos import QoSProfile


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
        Profile that publisher and subscriber both use.
    """

    name: str
    type: Any
    qos: QoSProfile

    @property
    def type_name(self) -> str:
        """Type as ROS writes it, for example 'sensor_msgs/msg/JointState'."""
        package, folder, *_ = self.type.__module__.split('.')
        return f'{package}/{folder}/{self.type.__name__}'
