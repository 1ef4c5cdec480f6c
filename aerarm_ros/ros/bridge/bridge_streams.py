"""The bridge's 1 kHz topics as serialized bytes."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample, JointStateCdr
from aerarm_msgs_py.codecs.joint_state_conversion import decode_as_sent
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.motion.signals import Array

# Joint names and content of a joint command, and the GID of its publisher, None where unknown.
Command = tuple[Sequence[str], JointSample, bytes | None]

# A command of other joints in another order is read by the cycle itself; what is longer than any
# command would take it more time than it has.
_LONGEST = 1024  # [bytes]
_LONGEST_PER_JOINT = 128


class BridgeStreams:
    """Publishes states and takes commands without building message objects.

    Parameters
    ----------
    node
        Owner of publishers and subscription.
    names
        Joint names, n of them, in the order of all arrays.
    """

    def __init__(self, node: Node, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._cdr = JointStateCdr(names)
        self._power_cdr = Float64ArrayCdr(len(self._names))
        self._node = node
        self._joint_states, self._motor_states, self._motor_power = (
            node.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.JOINT_STATES, topics.MOTOR_STATES, topics.MOTOR_POWER)
        )
        self.commands = RawReader(node, topics.JOINT_COMMAND, identify=True)

    def publish(
        self, stamp_ns: int, joints: Sequence[Array], motors: Sequence[Array], power: Array
    ) -> None:
        """Publish one cycle's states.

        Parameters
        ----------
        stamp_ns
            System time at which the frames were read [ns].
        joints
            Position [rad], velocity [rad/s], effort [Nm], (n,) each.
        motors
            Position [rad], velocity [rad/s], current [A], (n,) each.
        power
            (n,) Electrical power [W].
        """
        self.publish_joints(stamp_ns, joints)
        self._motor_states.publish(self._cdr.pack(stamp_ns, *motors))
        self._motor_power.publish(self._power_cdr.pack(power))

    def publish_joints(self, stamp_ns: int, joints: Sequence[Array]) -> None:
        """Publish joint_states alone; parameters as of `publish`."""
        self._joint_states.publish(self._cdr.pack(stamp_ns, *joints))

    def newest_command(self) -> Command | None:
        """Return names, content and publisher of the newest joint command, if there is one.

        Raises ValueError if the message cannot be read.
        """
        message = self.commands.take_newest()
        if message is None:
            return None
        payload, info = message
        publisher = info.get('publisher')
        sample = self._cdr.unpack(payload)
        if sample is not None:
            return self._names, sample, publisher
        if len(payload) > _LONGEST + _LONGEST_PER_JOINT * len(self._names):
            raise ValueError(f'{len(payload)} bytes are no joint command of this arm')
        return (*decode_as_sent(payload), publisher)

    def destroy(self) -> None:
        """Destroy publishers and subscription."""
        for publisher in (self._joint_states, self._motor_states, self._motor_power):
            self._node.destroy_publisher(publisher)
        self.commands.destroy()
