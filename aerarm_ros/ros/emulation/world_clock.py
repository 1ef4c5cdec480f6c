"""The time of an emulated world on /clock, for nodes with use_sim_time."""

from __future__ import annotations

import struct

from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.graph.rival_watch import RivalWatch

_PERIOD_NS = 5_000_000
_ADVICE = (
    ', each with a time of its own: give each a ROS_DOMAIN_ID of its own, or remap /clock of all '
    'but one'
)
# rosgraph_msgs/Clock: the encapsulation of little-endian CDR, seconds, nanoseconds.
_CDR = struct.Struct('<4BiI')
_ENCAPSULATION = (0, 1, 0, 0)


class WorldClock:
    """Publishes the time, as serialized bytes, 200 times a second of it.

    Parameters
    ----------
    node
        Owner of the publisher.
    """

    def __init__(self, node: Node) -> None:
        topic = topics.CLOCK
        self._node = node
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        self._due = 0
        self._told = b''
        self._rivals = RivalWatch(node, topic, _ADVICE)

    def tell(self, now_ns: int) -> None:
        """Publish `now_ns` [ns] if it is time."""
        if now_ns >= self._due:
            self._due = now_ns + _PERIOD_NS
            self._told = _CDR.pack(*_ENCAPSULATION, *divmod(now_ns, 1_000_000_000))
            self._publisher.publish(self._told)

    def tell_again(self) -> None:
        """Publish the last time once more, for who has not heard it."""
        if self._told:
            self._publisher.publish(self._told)

    def poll(self) -> None:
        """Look for another clock; to be called in every cycle, costs a microsecond."""
        self._rivals.poll()

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._rivals.destroy()
        self._node.destroy_publisher(self._publisher)
