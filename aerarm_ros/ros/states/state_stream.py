"""Reading of joint states, IMU samples, odometry and rotor commands as serialized messages."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import (
    JointSample,
    JointStateCdr,
    JointStateDecoder,
    decode_joint_state,
    in_order,
)
from aerarm_msgs_py.live_topics import RawMessage, RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.motion.signals import ArmState


class Answers:
    """Publish answers to joint states, and publish them again if a joint state is re-sent.

    Best-effort messages can be lost. An emulated arm that waits for an answer therefore re-sends
    its last joint state byte for byte. If the node has already answered this joint state, it
    publishes the same answer again, and processes nothing.

    Parameters
    ----------
    needed
        Whether the node must process a re-sent joint state that it has not answered.

    Attributes
    ----------
    state
        The newest joint state, serialized; b'' before the first.
    count
        Number of re-sent joint states.
    """

    def __init__(self, *, needed: bool = True) -> None:
        self.state = b''
        self.count = 0
        self._needed = needed
        self._is_resent = self._is_answered = False
        self._kept: dict[Publisher, Any] = {}

    def begin(self, state: bytes) -> bool:
        """Store a joint state (serialized); return whether it equals the previous joint state."""
        self._is_resent = state == self.state
        if self._is_resent:
            self.count += 1
        else:
            self.state, self._is_answered = state, not self._needed
        return self._is_resent

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Publish a message as answer to the newest joint state, and store it for `again`."""
        publisher.publish(message)
        self._kept[publisher] = message
        self._is_answered = True

    def again(self) -> bool:
        """Republish the last answers if the newest joint state is re-sent and already answered.

        Return whether the answers were republished; if so, the joint state needs no processing.
        """
        if not (self._is_resent and self._is_answered):
            return False
        for publisher, message in self._kept.items():
            publisher.publish(message)
        return True

    def withdraw(self) -> None:
        """Discard the stored answers, because they are no longer valid."""
        self._kept.clear()
        self._is_answered = not self._needed

    @property
    def is_resent(self) -> bool:
        """Whether the newest joint state is a copy of the previous joint state."""
        return self._is_resent

    @property
    def are_kept(self) -> bool:
        """Whether an answer was published since the last call of `withdraw`."""
        return bool(self._kept)


def base_header(stamp_ns: int, base_link: str) -> Header:
    """Return a message header with a stamp [ns since the epoch] and the frame `base_link`."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=base_link)


_COUNT_PERIOD = 1.0  # [s]


class StateSampler:
    """Read the newest message of a JointState topic, without decoding older messages.

    Parameters
    ----------
    node
        Owner of the subscription.
    names
        Names of the n required joints, in the order of the returned values.
    topic
        JointState topic; `joint_states` by default.

    Attributes
    ----------
    missing
        Required joints that no message has contained so far.
    unknown
        Required joints without a position in the newest message, because they are not homed.
    stamp_ns
        Stamp of the newest message [ns].
    """

    def __init__(
        self, node: Node, names: Sequence[str], topic: Topic = topics.JOINT_STATES
    ) -> None:
        self.missing: list[str] = []
        self.unknown: list[str] = []
        self.stamp_ns = 0
        self._names = list(names)
        self._may_be_partial = topic is not topics.JOINT_STATES
        self._reader = RawReader(node, topic)
        self._decoder = JointStateDecoder()
        self._counted = (time.monotonic(), 0)
        self._frequency = 0.0

    def newest(self) -> NDArray[np.float64] | None:
        """Return position, velocity and effort (3, n) [rad, rad/s, Nm] of the newest message.

        Missing values are NaN. Return None without a new message, or if `joint_states` lacks a
        position.
        """
        message = self._reader.take_newest()
        if message is None:
            return None
        stamps, values = self._decoder.decode(Payloads.of([message[0]]))
        self.stamp_ns = int(stamps[0])
        known = self._decoder.names
        self.missing = [name for name in self._names if name not in known]
        if self.missing:
            return None
        state = values[0][:, [known.index(name) for name in self._names]]
        finite = np.isfinite(state[0]).tolist()
        self.unknown = [
            name for name, is_known in zip(self._names, finite, strict=True) if not is_known
        ]
        return state if self._may_be_partial or not self.unknown else None

    def frequency(self, now: float) -> float:
        """Return the publishing rate over the last second [Hz], including lost messages.

        Parameters
        ----------
        now
            Monotonic time [s].
        """
        since, before = self._counted
        if now - since > _COUNT_PERIOD:
            total = self._reader.count() + (self._reader.lost() or 0)
            self._frequency = (total - before) / (now - since)
            self._counted = (now, total)
        return self._frequency

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._reader.destroy()


NamedThrusts = tuple[tuple[str, ...], NDArray[np.float64], float]
"""Names of rotors, their thrusts (n,) [N], and the stamp of the command [s]."""

_STATES = 0  # index among the topics


class StateStream:
    """Receive joint states and, if requested, IMU samples, odometry and rotor commands.

    Attributes
    ----------
    stamp_ns
        Stamp of the newest joint state [ns], None before the first.
    answers
        Messages that are published in answer to joint states.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    names
        Names of the n joints, in the order of all arrays.
    reject
        Called with the reason why a message is rejected.
    rotors
        Names of the rotors. Without names the object does not subscribe to rotor commands.
    depth
        Queue length of joint states and IMU samples. Above 1, the object returns every joint state,
        the oldest first, and each IMU sample with the first joint state after it.
    imu
        Whether to subscribe to the IMU. A sample ends a wait and must then be read.
    odometry
        Whether to subscribe to the odometry; a message ends a wait and must then be read.
    answered
        Whether the node must answer each joint state, see `Answers`.
    """

    def __init__(
        self,
        node: Node,
        names: Sequence[str],
        reject: Callable[[str], None],
        rotors: Sequence[str] = (),
        depth: int = 1,
        imu: bool = True,
        odometry: bool = False,
        answered: bool = True,
    ) -> None:
        self.answers = Answers(needed=answered)
        self._names = tuple(names)
        self._cdr = JointStateCdr(self._names)
        self._reject = reject
        self._rotors = JointStateCdr(rotors) if rotors else None
        given = [topics.JOINT_STATES, *([topics.IMU] if imu else [])]
        self._gives_all = depth > 1
        if self._gives_all:
            given = [topic.queued(depth) for topic in given]
        self._imu_place = 1 if imu else None
        self._odometry_place = len(given) if odometry else None
        given += [topics.ODOMETRY] if odometry else []
        self._rotors_place = len(given)
        self._reader = RawReader(node, *given, *([topics.ROTOR_COMMAND] if rotors else []))
        self._early: deque[RawMessage] = deque(maxlen=depth)
        self._no_effort = np.full(len(self._names), np.nan)
        self._published_ns = self._received_ns = 0
        self.stamp_ns: int | None = None
        self._lost_before = 0

    @property
    def received(self) -> int:
        """Number of received joint states."""
        return self._reader.count(_STATES)

    @property
    def lost(self) -> int | None:
        """Number of joint states lost since `begin_count`, None if the middleware has no count."""
        lost = self._reader.lost(_STATES)
        return None if lost is None else lost - self._lost_before

    def begin_count(self) -> None:
        """Set the number of lost joint states to zero."""
        self._lost_before = self._reader.lost(_STATES) or 0

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return False after a time-out or stop signal."""
        return self._reader.wait(timeout)

    def newest_state(self) -> tuple[int, ArmState] | None:
        """Return stamp [ns] and content of the newest joint state, None without a valid message.

        With a queue (`depth` above 1), return the oldest unread joint state.
        """
        take = self._reader.take if self._gives_all else self._reader.take_newest
        message = take(_STATES)
        if message is None:
            return None
        payload, info = message
        self._published_ns = info['source_timestamp']
        if not self.answers.begin(payload):
            self._received_ns = info['received_timestamp']
        sample = self._cdr.unpack(payload) or self._decode(payload)
        if sample is None:
            return None
        q, dq, tau = sample.position, sample.velocity, sample.effort
        if q is None or dq is None:
            self._reject(
                'joint_states rejected, because position or velocity is missing: check the '
                'publisher'
            )
            return None
        self.stamp_ns = sample.stamp_ns
        return sample.stamp_ns, ArmState(q, dq, self._no_effort if tau is None else tau)

    def latency_ns(self) -> int:
        """Return the time since the publication of the newest joint state [ns], in real time.

        The stamps are not suitable, because the stamps of an emulated arm are in simulation time.
        """
        return time.time_ns() - self._published_ns

    def imu_samples(self) -> list[tuple[ImuSample, int]]:
        """Return unread IMU samples, each with its arrival time before the newest joint state [ns].

        The time is negative if the sample arrived after the newest joint state. The method reports
        and skips invalid samples.
        """
        samples: list[tuple[ImuSample, int]] = []
        if self._imu_place is None:
            return samples
        waiting = list(self._early)
        self._early.clear()
        while (message := self._reader.take(self._imu_place)) is not None:
            waiting.append(message)
        for payload, info in waiting:
            if self._gives_all and info['received_timestamp'] > self._received_ns:
                self._early.append((payload, info))
                continue
            sample = decoded_imu(payload, self._reject)
            if sample is not None:
                samples.append((sample, self._received_ns - info['received_timestamp']))
        return samples

    def odometry(self) -> Odometry | None:
        """Return the newest unread odometry message, or None."""
        if self._odometry_place is None:
            return None
        raw = self._reader.take_newest(self._odometry_place)
        return None if raw is None else decoded_odometry(raw[0], self._reject)

    def rotor_command(self) -> tuple[int, NamedThrusts] | None:
        """Return the newest unread rotor command, or None.

        The result is the time from its arrival to that of the newest joint state [ns], and the
        command.
        """
        if self._rotors is None:
            return None
        message = self._reader.take_newest(self._rotors_place)
        if message is None:
            return None
        payload, info = message
        try:
            names, stamp_ns, thrust = decoded_rotors(self._rotors, payload)
        except ValueError as error:
            self._reject(f'rotor_command: {error}')
            return None
        return self._received_ns - info['received_timestamp'], (names, thrust, stamp_ns * 1e-9)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _decode(self, payload: bytes) -> JointSample | None:
        """Decode a joint state whose joints are in another order than `names`."""
        try:
            names, sample = decode_joint_state(payload)
            return in_order(names, sample, self._names)
        except ValueError as error:
            self._reject(
                f'joint_states rejected ({error}): use the same config, urdf and tf_prefix for '
                'this node and the bridge'
            )
            return None


def decoded_rotors(
    cdr: JointStateCdr, payload: bytes
) -> tuple[tuple[str, ...], int, NDArray[np.float64]]:
    """Return rotor names, stamp [ns] and thrusts [N] of a rotor command; raises ValueError."""
    names, sample = cdr.names, cdr.unpack(payload)
    if sample is None:
        names, sample = decode_joint_state(payload)
    if sample.effort is None:
        raise ValueError(
            'the field effort is empty: send the thrust of each rotor [N] in this field'
        )
    return names, sample.stamp_ns, sample.effort


def decoded_odometry(payload: bytes, reject: Callable[[str], None]) -> Odometry | None:
    """Decode a serialized odometry message; report an invalid message and return None."""
    try:
        return deserialize_message(payload, Odometry)
    except RuntimeError as error:  # RMWError: not a valid message
        reject(f'odometry: {error}')
        return None


def decoded_imu(payload: bytes, reject: Callable[[str], None]) -> ImuSample | None:
    """Decode a serialized IMU message; report an invalid message and return None."""
    try:
        return to_imu_sample(deserialize_message(payload, Imu))
    except RejectedInputError as error:
        reject(str(error))
    except RuntimeError as error:  # RMWError: not a valid message
        reject(f'imu: {error}')
    return None


def to_imu_sample(message: Imu) -> ImuSample:
    """Convert an IMU message to a checked sample; raises RejectedInputError."""
    q, w, f = message.orientation, message.angular_velocity, message.linear_acceleration
    # sensor_msgs/Imu: a negative first covariance means that the measurement is absent.
    absent = (message.angular_velocity_covariance, message.linear_acceleration_covariance)
    if any(covariance[0] < 0.0 for covariance in absent):
        raise RejectedInputError(
            'imu rejected, because angular velocity or acceleration is missing: check the publisher'
        )
    has_attitude = message.orientation_covariance[0] >= 0.0
    stamp = message.header.stamp
    return ImuSample(
        stamp.sec + 1e-9 * stamp.nanosec,
        np.array([q.x, q.y, q.z, q.w]) if has_attitude else None,
        np.array([w.x, w.y, w.z]),
        np.array([f.x, f.y, f.z]),
    )
