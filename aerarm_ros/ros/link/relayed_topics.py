"""Relay of topics between drone and ground, at lower rates."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.link.connection import BULK, MESSAGE_MAX, PROMPT, VALUE_MAX, Connection, SentMessage

STATES = (topics.JOINT_STATES, topics.JOINT_COMMAND, topics.MOTOR_STATES, topics.ROTOR_COMMAND)
"""JointState topics; the ground receives only the newest message, in single precision."""
VALUES = (
    topics.MOTOR_POWER,
    topics.ENERGY,
    topics.TOOL_POSE,
    topics.IMU,
    topics.ODOMETRY,
    topics.EXTERNAL_ODOMETRY,
    topics.ARM_REACH,
    topics.BASE_WRENCH,
    topics.ARM_INERTIA,
    topics.ARM_COM,
    topics.PAYLOAD,
    topics.JOINT_FRICTION,
    topics.CONTACT_WRENCH,
    topics.STATIC_WRENCH,
    topics.RECORDED_UNTIL,
)
"""Other periodic topics; the ground receives only the newest message, at a lower rate."""
SILENT = 2.0
"""Time [s] without a joint state after which the drone warns."""
EVENTS = (
    topics.ARM_MODE,
    topics.PLAN_STATUS,
    topics.TOOL_PATH,
    topics.ROBOT_DESCRIPTION,
    topics.RECORDER_STATUS,
    topics.COMMISSIONING_REPORT,
    topics.DIAGNOSTICS,
)
"""Topics of which the ground receives every message."""
COMMANDS = (
    topics.JOINT_TRAJECTORY,
    topics.JOINT_GOAL,
    topics.TOOL_GOAL,
    topics.SET_POINT,
    topics.TOOL_TRAJECTORY,
    topics.TOOL_MOTION,
    topics.FLIGHT_TRAJECTORY,
    topics.FLIGHT_SET_POINT,
    topics.COMMISSIONING_REQUEST,
)
"""Topics that the ground sends to the drone. `joint_command` is excluded, because a controller must
run on the bridge's host.
"""
COMMAND_LIFETIME = 1.0
"""Time [s] after which an undelivered command expires. A motion must not begin after a loss of
connection if the command was sent before the loss.
"""

ALL_STATES, OFFERED, STOPS, CALLS, STOP_RESULTS, RESULTS = range(1000, 1006)
"""Channels that are not topics. E-stops have a separate channel, in which they never wait for other
messages.
"""
STREAMS = (*STATES, *VALUES)
DOWN = (*STREAMS, *EVENTS)
UP_CHANNEL = 100
_DEPTH = 100
_PLACE = struct.Struct('<BI')  # channel of a state, size
_LATCHED = topics.LATCHED.durability


class DroneTopics:
    """Send the drone's topics to the ground, and publish commands from the ground.

    Parameters
    ----------
    node
        Owner of subscriptions and publishers.
    connection
        Connection to the ground computer.
    rate, values_rate
        Rates of `STATES` and of `VALUES` [Hz].
    """

    def __init__(self, node: Node, connection: Connection, rate: float, values_rate: float) -> None:
        self._connection = connection
        self._streams = RawReader(node, *STREAMS)
        self._events = RawReader(node, *(topic.queued(_DEPTH) for topic in EVENTS))
        self._states_at: float | None = None  # [s], of the newest joint states
        self._periods = 1.0 / rate, 1.0 / values_rate
        self._due = [0.0, 0.0]
        self._latched: dict[int, tuple[bytes, SentMessage]] = {}
        # newest diagnostics during a loss of connection, by the names of their statuses
        self._kept: dict[tuple[str, ...], SentMessage] = {}
        self._publishers = [topic.publisher(node) for topic in COMMANDS]

    def update(self, now: float) -> None:
        """Pass messages that were received from the drone's nodes to the connection."""
        for place, topic in enumerate(EVENTS):
            for payload in _waiting(self._events, place):
                if topic is topics.DIAGNOSTICS:
                    self._send_diagnostics(payload, self._connection.is_up(now))
                else:
                    self._send_event(len(STREAMS) + place, payload)
        for place, (send, period) in enumerate(
            zip((self._send_states, self._send_values), self._periods, strict=True)
        ):
            if now >= self._due[place]:
                self._due[place] = max(self._due[place] + period, now - period)
                send(now)
        if self._connection.is_up(now):
            self._send_dropped()

    def greet(self) -> None:
        """Send latched messages again, because the ground has just connected."""
        for channel, (payload, message) in list(self._latched.items()):
            if message.is_confirmed or message.is_expired:
                self._send_event(channel, payload)

    def problem(self, now: float) -> str:
        """Return a warning if no joint states arrive, or an empty string."""
        name = topics.JOINT_STATES.name
        if self._states_at is None:
            return f'no message on the drone on {name}: start the bridge on the drone'
        if now - self._states_at > max(SILENT, 2.0 * self._periods[0]):
            return (
                f'no message on the drone on {name} for {now - self._states_at:.0f} s: check the '
                'bridge on the drone'
            )
        return ''

    def publish(self, channel: int, payload: bytes) -> None:
        """Publish a command that was received from the ground."""
        place = channel - UP_CHANNEL
        if 0 <= place < len(self._publishers):
            self._publishers[place].publish(payload)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._streams.destroy()
        self._events.destroy()

    def _send_states(self, now: float) -> None:
        """Send the newest states together, because equal joint names then take space only once."""
        parts = {}
        for channel in range(len(STATES)):
            message = self._streams.take_newest(channel)
            if message is not None:
                parts[channel] = _single_precision(message[0])
        if 0 in parts:
            self._states_at = now
        if not parts:
            return
        content = b''.join(_PLACE.pack(k, len(part)) + part for k, part in parts.items())
        together = zlib.compress(content, 9)
        if len(together) <= VALUE_MAX:
            self._connection.set_value(ALL_STATES, together)
            return
        for channel, part in parts.items():
            self._connection.set_value(channel, zlib.compress(part, 9))

    def _send_values(self, _: float) -> None:
        for channel in range(len(STATES), len(STREAMS)):
            message = self._streams.take_newest(channel)
            if message is not None:
                self._connection.set_value(channel, zlib.compress(message[0], 1))

    def _send_diagnostics(self, payload: bytes, is_up: bool) -> None:
        """Send diagnostics; without connection, a message replaces an older unsent message."""
        channel = DOWN.index(topics.DIAGNOSTICS)
        if is_up:
            self._kept.clear()
            self._send_event(channel, payload)
            return
        names: tuple[str, ...] = ()
        with suppress(RuntimeError):  # malformed message of another program
            content = deserialize_message(payload, DiagnosticArray)
            names = tuple(status.name for status in content.status)
        if names in self._kept:
            self._connection.withdraw(self._kept[names])
        self._kept[names] = self._connection.send(channel, payload, BULK)

    def _send_event(self, channel: int, payload: bytes) -> None:
        is_bulk = DOWN[channel] in (topics.DIAGNOSTICS, topics.ROBOT_DESCRIPTION)
        message = self._connection.send(channel, payload, BULK if is_bulk else PROMPT)
        if DOWN[channel].qos.durability == _LATCHED:
            self._latched[channel] = payload, message

    def _send_dropped(self) -> None:
        """Re-send latched messages that a full queue dropped during a loss of connection."""
        for channel, (payload, message) in list(self._latched.items()):
            if message.is_expired and len(payload) <= MESSAGE_MAX:
                self._send_event(channel, payload)


def _single_precision(payload: bytes) -> bytes:
    """Round the numbers of a JointState to single precision, which compresses better."""
    try:
        message = deserialize_message(payload, JointState)
    except RuntimeError:  # malformed message of another program
        return payload
    for name in ('position', 'velocity', 'effort'):
        setattr(message, name, array('d', array('f', getattr(message, name))))
    return bytes(serialize_message(message))


class GroundTopics:
    """Publish the drone's topics on the ground computer, and send commands to the drone.

    A topic is created with its first message, so tools show only topics that the drone publishes.

    Parameters
    ----------
    node
        Owner of subscriptions and publishers.
    connection
        Connection to the drone.
    on_expired
        Called with the name of a topic if a command did not reach the drone in time.
    """

    def __init__(
        self, node: Node, connection: Connection, on_expired: Callable[[str], None]
    ) -> None:
        self._node = node
        self._connection = connection
        self._on_expired = on_expired
        self._reader = RawReader(node, *(topic.queued(_DEPTH) for topic in COMMANDS))
        self._publishers: dict[str, Publisher] = {}
        self._under_way: list[tuple[str, SentMessage]] = []

    def update(self, now: float) -> bool:
        """Send commands of nodes on the ground to the drone; return whether any was received."""
        has_sent = False
        for place, topic in enumerate(COMMANDS):
            for payload in _waiting(self._reader, place):
                expires = now + COMMAND_LIFETIME
                sent = self._connection.send(UP_CHANNEL + place, payload, PROMPT, expires)
                self._under_way.append((topic.name, sent))
                has_sent = True
        for name, sent in self._under_way:
            if sent.is_expired:
                self._on_expired(name)
        self._under_way = [
            (name, sent)
            for name, sent in self._under_way
            if not (sent.is_expired or sent.is_confirmed)
        ]
        return has_sent

    def publish(self, channel: int, payload: bytes) -> None:
        """Publish a message that was received from the drone."""
        if channel == ALL_STATES:
            content = _unpacked(payload)
            while content:
                place, size = _PLACE.unpack_from(content)
                self._publisher(STATES[place]).publish(content[_PLACE.size :][:size])
                content = content[_PLACE.size + size :]
        elif channel < len(STREAMS):
            self._publisher(STREAMS[channel]).publish(_unpacked(payload))
        elif channel < len(DOWN):
            self._publisher(DOWN[channel]).publish(payload)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _publisher(self, topic: Topic) -> Publisher:
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = topic.publisher(self._node)
        return publisher


def _unpacked(content: bytes) -> bytes:
    return zlib.decompressobj().decompress(content, MESSAGE_MAX)


def _waiting(reader: RawReader, index: int) -> Iterator[bytes]:
    """Yield at most 100 waiting messages of a topic."""
    for _ in range(_DEPTH):
        message = reader.take(index)
        if message is None:
            return
        yield message[0]
