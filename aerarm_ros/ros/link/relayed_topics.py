"""Topics that `ground_link` relays, and the decimation of joint states."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.link.connection import BULK, PROMPT, Connection, Message
from aerarm_ros.link.windows import Window, pack_window, unpack_window, window_of

WINDOWED = (
    topics.JOINT_STATES,
    topics.JOINT_COMMAND,
    topics.MOTOR_STATES,
    topics.ROTOR_COMMAND,
)
"""Joint states of the drone that are decimated, with minimum and maximum."""
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
"""Other streams of the drone, of which the newest message of each window is sent unchanged."""
EVENTS = (
    topics.ARM_MODE,
    topics.PLAN_STATUS,
    topics.TOOL_PATH,
    topics.ROBOT_DESCRIPTION,
    topics.RECORDER_STATUS,
    topics.COMMISSIONING_REPORT,
    topics.DIAGNOSTICS,
)
"""Topics that the ground receives without loss."""
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
"""Topics that the ground sends. `joint_command` is excluded, because a controller must run on the
bridge's host.
"""
COMMAND_LIFETIME = 1.0
"""[s] Lifetime of a command, so that no motion requested before a loss of connection begins after
it.
"""

LAYOUTS, OFFERED, STOPS, CALLS, STOP_RESULTS, RESULTS = range(1000, 1006)
"""Channels other than topics. Stop requests have their own channel, so that they never queue
behind others.
"""
DOWN = (*WINDOWED, *VALUES, *EVENTS)
UP_CHANNEL = 100
_DEPTH = 100
_FIELDS = ('position', 'velocity', 'effort')
_LATCHED = topics.LATCHED.durability


class DroneTopics:
    """Send the drone's topics to the ground, and publish the ground's commands.

    Parameters
    ----------
    node
        Owner of subscriptions and publishers.
    connection
        Connection to the ground computer.
    rates
        Rate of each decimated topic [Hz], by topic name.
    """

    def __init__(self, node: Node, connection: Connection, rates: Mapping[str, float]) -> None:
        self._connection = connection
        self._reader = RawReader(node, *(topic.queued(_DEPTH) for topic in DOWN))
        self._windows = [JointStateStream() for _ in WINDOWED]
        self._periods = [1.0 / rates[topic.name] for topic in (*WINDOWED, *VALUES)]
        self._due = [0.0] * len(self._periods)
        self._newest: list[bytes | None] = [None] * len(VALUES)
        self._latched: dict[int, tuple[bytes, Message]] = {}
        self._publishers = [_publisher(node, topic) for topic in COMMANDS]

    def update(self, now: float) -> None:
        """Pass received messages to the connection."""
        for channel in range(len(DOWN)):
            while (message := self._reader.take(channel)) is not None:
                self._take(channel, message[0])
        for channel, period in enumerate(self._periods):
            if now >= self._due[channel]:
                self._due[channel] = max(self._due[channel] + period, now - period)
                self._send_value(channel)

    def greet(self) -> None:
        """Send latched messages and layouts to a ground computer whose link has just started."""
        for channel, (payload, message) in list(self._latched.items()):
            if message.is_confirmed or message.is_expired:
                self._send_event(channel, payload)
        for channel, stream in enumerate(self._windows):
            if stream.layout:
                self._connection.send(LAYOUTS, _layout_text(channel, stream.layout))

    def publish(self, channel: int, payload: bytes) -> None:
        """Publish a command from the ground computer."""
        place = channel - UP_CHANNEL
        if 0 <= place < len(self._publishers):
            self._publishers[place].publish(payload)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _take(self, channel: int, payload: bytes) -> None:
        if channel < len(WINDOWED):
            stream = self._windows[channel]
            if stream.add(payload):
                self._connection.send(LAYOUTS, _layout_text(channel, stream.layout))
        elif channel < len(WINDOWED) + len(VALUES):
            self._newest[channel - len(WINDOWED)] = payload
        else:
            self._send_event(channel, payload)

    def _send_event(self, channel: int, payload: bytes) -> None:
        is_bulk = DOWN[channel] in (topics.DIAGNOSTICS, topics.ROBOT_DESCRIPTION)
        message = self._connection.send(channel, payload, BULK if is_bulk else PROMPT)
        if DOWN[channel].qos.durability == _LATCHED:
            self._latched[channel] = payload, message

    def _send_value(self, channel: int) -> None:
        if channel < len(WINDOWED):
            window = self._windows[channel].take()
            if window is not None:
                self._connection.set_value(channel, pack_window(window))
            return
        place = channel - len(WINDOWED)
        newest, self._newest[place] = self._newest[place], None
        if newest is not None:
            self._connection.set_value(channel, zlib.compress(newest, 1))


class JointStateStream:
    """Samples of one topic since the last window.

    Attributes
    ----------
    layout
        Names, frame and field lengths of the messages; empty before the first.
    """

    def __init__(self) -> None:
        self.layout: dict[str, object] = {}
        self._codec: JointStateCdr | None = None
        self._samples: list[NDArray[np.float64]] = []
        self._stamp_ns = 0

    def add(self, payload: bytes) -> bool:
        """Add a message; return whether its layout is new."""
        sample = self._codec.unpack(payload) if self._codec is not None else None
        is_new = sample is None
        if sample is None:
            message = deserialize_message(payload, JointState)
            try:
                self._codec = JointStateCdr(list(message.name), message.header.frame_id)
            except ValueError:
                return False  # a message without names belongs to no arm
            sample = self._codec.unpack(payload)
            if sample is None:
                return False
        full = [name for name in _FIELDS if getattr(sample, name) is not None]
        is_new = is_new or full != self.layout.get('full')
        if is_new:
            assert self._codec is not None
            self._samples = []
            self.layout = {
                'names': list(self._codec.names),
                'frame': self._codec.frame_id,
                'full': full,
            }
        if not full:
            return False
        self._samples.append(np.concatenate([getattr(sample, name) for name in full]))
        self._stamp_ns = sample.stamp_ns
        return is_new

    def take(self) -> Window | None:
        """Return the window since the last call, None without a message."""
        samples, self._samples = self._samples, []
        return window_of(self._stamp_ns, samples) if samples else None


class GroundTopics:
    """Publish the drone's topics on the ground computer, and send the ground's commands.

    A topic is created with its first message, so tools show only topics that the drone publishes.

    Parameters
    ----------
    node
        Owner of subscriptions and publishers.
    connection
        Connection to the drone.
    on_expired
        Receives the name of a topic whose command was not delivered in time.
    """

    def __init__(
        self, node: Node, connection: Connection, on_expired: Callable[[str], None]
    ) -> None:
        self._node = node
        self._connection = connection
        self._on_expired = on_expired
        self._reader = RawReader(node, *(topic.queued(_DEPTH) for topic in COMMANDS))
        self._publishers: dict[str, Publisher] = {}
        self._layouts: dict[int, tuple[JointStateCdr, list[str]]] = {}
        self._under_way: list[tuple[str, Message]] = []

    def update(self, now: float) -> bool:
        """Send received commands; return whether there were any."""
        has_sent = False
        for place, topic in enumerate(COMMANDS):
            while (message := self._reader.take(place)) is not None:
                expires = now + COMMAND_LIFETIME
                sent = self._connection.send(UP_CHANNEL + place, message[0], PROMPT, expires)
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
        """Publish a value or an event of the drone."""
        if channel < len(WINDOWED):
            self._publish_window(channel, payload)
        elif channel < len(WINDOWED) + len(VALUES):
            self._publisher(DOWN[channel]).publish(zlib.decompress(payload))
        elif channel < len(DOWN):
            self._publisher(DOWN[channel]).publish(payload)

    def take_layout(self, payload: bytes) -> None:
        """Store the layout of a topic's joint states."""
        given = json.loads(payload)
        codec = JointStateCdr(given['names'], given['frame'])
        self._layouts[given['channel']] = codec, given['full']

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _publish_window(self, channel: int, payload: bytes) -> None:
        if channel not in self._layouts:
            return
        codec, full = self._layouts[channel]
        window = unpack_window(payload)
        if len(window.newest) != len(full) * len(codec.names):
            return  # its layout has not arrived yet
        topic = DOWN[channel]
        for suffix, numbers in (
            ('', window.newest),
            ('/minimum', window.minimum),
            ('/maximum', window.maximum),
        ):
            fields = dict(zip(full, np.split(numbers, len(full)), strict=True))
            message = codec.pack(window.stamp_ns, **fields)
            self._publisher(Topic(topic.name + suffix, topic.type, topic.qos)).publish(message)

    def _publisher(self, topic: Topic) -> Publisher:
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = _publisher(self._node, topic)
        return publisher


def topic_rates(rate: float, values_rate: float, changes: Sequence[str]) -> dict[str, float]:
    """Return the rate of each decimated topic [Hz].

    Parameters
    ----------
    rate, values_rate
        Rate of joint states, and of other streams [Hz].
    changes
        Texts NAME=HZ.

    Raises
    ------
    ValueError
        If a text has another form, or names another topic.
    """
    rates = {topic.name: rate for topic in WINDOWED} | {topic.name: values_rate for topic in VALUES}
    for text in filter(None, changes):
        name, _, number = text.partition('=')
        try:
            hertz = float(number)
        except ValueError:
            hertz = 0.0
        if name not in rates:
            raise ValueError(
                f"the rate of '{name}' (rates) cannot be set: choose one of {', '.join(rates)}"
            )
        if not 0.1 <= hertz <= 50.0:
            raise ValueError(f"'{text}' in rates is invalid: write {name}=HZ with 0.1 to 50 Hz")
        rates[name] = hertz
    return rates


def _publisher(node: Node, topic: Topic) -> Publisher:
    return node.create_publisher(topic.type, topic.name, topic.offered)


def _layout_text(channel: int, layout: Mapping[str, object]) -> bytes:
    return json.dumps({'channel': channel, **layout}).encode()
