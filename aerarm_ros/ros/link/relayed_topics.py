"""Relay of topics between drone and ground, and decimation of joint states."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample, JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.link.connection import BULK, MESSAGE_MAX, PROMPT, Connection, SentMessage

_HEAD = struct.Struct('<qH')  # stamp, numbers


class Window(NamedTuple):
    """Summary of the samples of one topic during a time window.

    Attributes
    ----------
    stamp_ns
        Stamp of the newest sample [ns].
    newest, minimum, maximum : (n,) ndarray
        Newest sample, and extremes of each of the n numbers. The extremes are NaN where a sample of
        the window is NaN.
    """

    stamp_ns: int
    newest: NDArray[np.float64]
    minimum: NDArray[np.float64]
    maximum: NDArray[np.float64]


def pack_window(stamp_ns: int, samples: Sequence[NDArray[np.float64]]) -> bytes:
    """Summarize samples (n,) as bytes: the newest in single, the extremes in half precision.

    `stamp_ns` [ns] is the stamp of the last sample.
    """
    rows = np.stack(samples)
    newest = rows[-1].astype('<f4')
    with np.errstate(over='ignore', invalid='ignore'):
        below = _rounded_up(newest - rows.min(axis=0))
        above = _rounded_up(rows.max(axis=0) - newest)
    parts = newest, below, above
    return _HEAD.pack(stamp_ns, len(newest)) + b''.join(part.tobytes() for part in parts)


def unpack_window(content: bytes) -> Window:
    """Decode a window from bytes; raise ValueError if the bytes are invalid."""
    stamp_ns, n = _HEAD.unpack_from(content.ljust(_HEAD.size, b'\0'))
    if len(content) != _HEAD.size + 8 * n:
        raise ValueError(
            f'a window of joint states has {len(content)} bytes instead of {_HEAD.size + 8 * n}'
        )
    newest = np.frombuffer(content, '<f4', n, _HEAD.size).astype(float)
    below, above = np.frombuffer(content, '<f2', 2 * n, _HEAD.size + 4 * n).reshape(2, n)
    return Window(stamp_ns, newest, newest - below, newest + above)


def _rounded_up(distance: NDArray[np.float64]) -> NDArray[np.float16]:
    """Convert non-negative numbers to half precision, rounded up."""
    half = np.maximum(distance, 0.0).astype('<f2')
    low = half < distance
    half[low] = np.nextafter(half[low], np.float16(np.inf))
    return half


WINDOWED = (topics.JOINT_STATES, topics.JOINT_COMMAND, topics.MOTOR_STATES, topics.ROTOR_COMMAND)
"""JointState topics; the ground receives the newest sample and the extremes of each window."""
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
STEADY = (
    topics.JOINT_STATES,
    topics.MOTOR_STATES,
    topics.MOTOR_POWER,
    topics.IMU,
    topics.ODOMETRY,
    topics.EXTERNAL_ODOMETRY,
    topics.TOOL_POSE,
    topics.BASE_WRENCH,
    topics.ARM_INERTIA,
    topics.ARM_COM,
)
"""Topics that their publishers publish periodically without pauses."""
SILENT = 2.0
"""Time [s] without a message after which the drone warns about a topic in `STEADY`."""
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

LAYOUTS, OFFERED, STOPS, CALLS, STOP_RESULTS, RESULTS = range(1000, 1006)
"""Channels that are not topics. E-stops have a separate channel, in which they never wait for other
messages.
"""
DOWN = (*WINDOWED, *VALUES, *EVENTS)
UP_CHANNEL = 100
_DEPTH = 100
_WINDOWS = 2000  # first channel of windows
_LAYOUTS_MAX = 8  # layouts of one topic that are in use at the same time
_KNOWN_MAX = 64  # layouts that the ground stores
_LAYOUT = struct.Struct('<I')  # checksum of a layout's text, which names the layout of a window
_FIELDS = ('position', 'velocity', 'effort')
_LATCHED = topics.LATCHED.durability


class DroneTopics:
    """Send the drone's topics to the ground, and publish commands from the ground.

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
        self._node = node
        self._connection = connection
        self._reader = RawReader(node, *(topic.queued(_DEPTH) for topic in DOWN))
        self._came: dict[str, float] = {}  # [s], of the newest message of each topic
        self._windows = [JointStateStream(self._send_layout) for _ in WINDOWED]
        self._periods = [1.0 / rates[topic.name] for topic in (*WINDOWED, *VALUES)]
        self._due = [0.0] * len(self._periods)
        self._newest: list[bytes | None] = [None] * len(VALUES)
        self._latched: dict[int, tuple[bytes, SentMessage]] = {}
        # newest diagnostics during a loss of connection, by the names of their statuses
        self._kept: dict[tuple[str, ...], SentMessage] = {}
        self._publishers = [topic.publisher(node) for topic in COMMANDS]

    def update(self, now: float) -> None:
        """Pass messages that were received from the drone's nodes to the connection."""
        for channel in range(len(DOWN)):
            for payload in _waiting(self._reader, channel):
                self._came[DOWN[channel].name] = now
                if DOWN[channel] is topics.DIAGNOSTICS:
                    self._send_diagnostics(channel, payload, self._connection.is_up(now))
                else:
                    self._take(channel, payload)
        for channel, period in enumerate(self._periods):
            if now >= self._due[channel]:
                self._due[channel] = max(self._due[channel] + period, now - period)
                self._send_value(channel)
        if self._connection.is_up(now):
            self._send_dropped()

    def greet(self) -> None:
        """Send latched messages and layouts again, because the ground has just connected."""
        for channel, (payload, message) in list(self._latched.items()):
            if message.is_confirmed or message.is_expired:
                self._send_event(channel, payload)
        for text in [text for stream in self._windows for text in stream.layouts]:
            self._send_layout(text)

    def problem(self, now: float) -> str:
        """Return a warning about topics in `STEADY` without recent messages, or an empty string.

        A topic without a publisher counts as ended, except `joint_states`, because a bridge must
        run.
        """
        ages = {
            topic.name: now - self._came[topic.name]
            for topic in STEADY
            if now - self._came.get(topic.name, now) > SILENT
            and (topic is topics.JOINT_STATES or self._node.count_publishers(topic.name))
        }
        if ages:
            listed = ', '.join(f'{name} for {age:.0f} s' for name, age in ages.items())
            return f'no message on the drone on {listed}: check the nodes that publish these topics'
        if topics.JOINT_STATES.name not in self._came:
            return (
                f'no message on the drone on {topics.JOINT_STATES.name}: start the bridge on the '
                'drone'
            )
        return ''

    def publish(self, channel: int, payload: bytes) -> None:
        """Publish a command that was received from the ground."""
        place = channel - UP_CHANNEL
        if 0 <= place < len(self._publishers):
            self._publishers[place].publish(payload)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _take(self, channel: int, payload: bytes) -> None:
        if channel < len(WINDOWED):
            self._windows[channel].add(payload)
        elif channel < len(WINDOWED) + len(VALUES):
            self._newest[channel - len(WINDOWED)] = payload
        else:
            self._send_event(channel, payload)

    def _send_layout(self, text: bytes) -> None:
        self._connection.send(LAYOUTS, text)

    def _send_diagnostics(self, channel: int, payload: bytes, is_up: bool) -> None:
        """Send diagnostics; without connection, a message replaces an older unsent message."""
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

    def _send_value(self, channel: int) -> None:
        if channel < len(WINDOWED):
            first = _WINDOWS + channel * _LAYOUTS_MAX
            for slot, content in self._windows[channel].take():
                self._connection.set_value(first + slot, content)
            return
        place = channel - len(WINDOWED)
        newest, self._newest[place] = self._newest[place], None
        if newest is not None:
            self._connection.set_value(channel, zlib.compress(newest, 1))


class JointStateStream:
    """Collect the samples of one topic, and summarize them in windows.

    Publishers of one topic may order the joints differently, or fill other fields. A layout is one
    such order and set of fields. Samples of different layouts never share a window.

    Parameters
    ----------
    on_layout
        Called with the text of each new layout.
    """

    def __init__(self, on_layout: Callable[[bytes], object]) -> None:
        self._on_layout = on_layout
        self._codecs: list[JointStateCdr] = []
        self._slots: dict[tuple[JointStateCdr, tuple[str, ...]], _Slot] = {}

    @property
    def layouts(self) -> list[bytes]:
        """Texts that describe the present layouts."""
        return [slot.text for slot in self._slots.values()]

    def add(self, payload: bytes) -> None:
        """Add a serialized message to the present window; ignore a message without joint names."""
        for codec in self._codecs:
            sample = codec.unpack(payload)
            if sample is not None:
                break
        else:
            found = self._learn(payload)
            if found is None:
                return
            codec, sample = found
        full = tuple(name for name in _FIELDS if getattr(sample, name) is not None)
        if not full:
            return
        slot = self._slots.get((codec, full)) or self._new_slot(codec, full)
        slot.samples.append(np.concatenate([getattr(sample, name) for name in full]))
        slot.stamp_ns = sample.stamp_ns

    def take(self) -> Iterator[tuple[int, bytes]]:
        """End the present windows; yield the slot number and the encoded content of each."""
        for key, slot in list(self._slots.items()):
            samples, slot.samples = slot.samples, []
            if samples:
                self._slots[key] = self._slots.pop(key)  # the last used is the last
                content = pack_window(slot.stamp_ns, samples)
                yield slot.place, _LAYOUT.pack(zlib.crc32(slot.text)) + content

    def _learn(self, payload: bytes) -> tuple[JointStateCdr, JointSample] | None:
        message = deserialize_message(payload, JointState)
        try:
            codec = JointStateCdr(list(message.name), message.header.frame_id)
        except ValueError:
            return None
        sample = codec.unpack(payload)
        if sample is None:
            return None
        self._codecs = [codec, *self._codecs][:_LAYOUTS_MAX]
        return codec, sample

    def _new_slot(self, codec: JointStateCdr, full: tuple[str, ...]) -> _Slot:
        place = len(self._slots)
        if place == _LAYOUTS_MAX:  # replace the layout that was not used for the longest time
            place = self._slots.pop(next(iter(self._slots))).place
        layout = {'names': codec.names, 'frame': codec.frame_id, 'full': full}
        slot = self._slots[codec, full] = _Slot(json.dumps(layout).encode(), place)
        self._on_layout(slot.text)
        return slot


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
        self._layouts: dict[int, tuple[JointStateCdr, list[str]]] = {}  # by checksum
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
        place = (channel - _WINDOWS) // _LAYOUTS_MAX
        if 0 <= place < len(WINDOWED):
            self._publish_window(WINDOWED[place], payload)
        elif len(WINDOWED) <= channel < len(WINDOWED) + len(VALUES):
            self._publisher(DOWN[channel]).publish(zlib.decompress(payload))
        elif len(WINDOWED) <= channel < len(DOWN):
            self._publisher(DOWN[channel]).publish(payload)

    def take_layout(self, payload: bytes) -> None:
        """Store a layout (joint names and fields) with which later windows are decoded."""
        given = json.loads(payload)
        if len(self._layouts) >= _KNOWN_MAX:
            del self._layouts[next(iter(self._layouts))]
        codec = JointStateCdr(given['names'], given['frame'])
        self._layouts[zlib.crc32(payload)] = codec, given['full']

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _publish_window(self, topic: Topic, payload: bytes) -> None:
        (name,) = _LAYOUT.unpack_from(payload)
        layout = self._layouts.pop(name, None)
        if layout is None:
            return  # the layout has not arrived yet
        self._layouts[name] = codec, full = layout
        window = unpack_window(payload[_LAYOUT.size :])
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
            publisher = self._publishers[topic.name] = topic.publisher(self._node)
        return publisher


def topic_rates(rate: float, values_rate: float, changes: Sequence[str]) -> dict[str, float]:
    """Return the rate of each decimated topic [Hz], by topic name.

    Parameters
    ----------
    rate, values_rate
        Default rates of `WINDOWED` and of `VALUES` [Hz].
    changes
        Rates of single topics, as texts NAME=HZ.

    Raises
    ------
    ValueError
        If a text has another form, or names a topic that is not decimated.
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
                f"the parameter rates names the topic '{name}', which has no adjustable rate: "
                f'choose one of {", ".join(rates)}'
            )
        if not 0.1 <= hertz <= 50.0:
            raise ValueError(
                f"'{text}' in the parameter rates is invalid: write {name}=HZ with 0.1 to 50 Hz"
            )
        rates[name] = hertz
    return rates


def _waiting(reader: RawReader, index: int) -> Iterator[bytes]:
    """Yield at most 100 waiting messages of a topic."""
    for _ in range(_DEPTH):
        message = reader.take(index)
        if message is None:
            return
        yield message[0]


@dataclass
class _Slot:
    text: bytes
    place: int
    samples: list[NDArray[np.float64]] = field(default_factory=list)
    stamp_ns: int = 0
