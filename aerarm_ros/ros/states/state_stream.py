"""Joint states, IMU samples and rotor commands, as serialized bytes, for a loop that takes them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample, JointStateCdr, JointStateDecoder
from aerarm_msgs_py.codecs.joint_state_conversion import decode_joint_state, in_order
from aerarm_msgs_py.live_topics import RawMessage, RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.states.answers import Answers


def base_header(stamp_ns: int, base_link: str) -> Header:
    """Return a header with the stamp of a state [ns since the epoch], see `Robot.base_link`."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=base_link)


class RotorThrusts(NamedTuple):
    """Commanded thrusts of a drone's rotors, as sent.

    Attributes
    ----------
    names
        Of the rotors, n of them.
    thrust
        (n,) [N]
    stamp
        [s]
    lead_ns
        How long before the newest state it came [ns].
    """

    names: tuple[str, ...]
    thrust: NDArray[np.float64]
    stamp: float
    lead_ns: int


_COUNT_PERIOD = 1.0  # [s]


class StateSampler:
    """Takes what is newest on a topic and leaves the rest, at no cost per message.

    Parameters
    ----------
    node
        Owner of the subscription.
    names
        Joints wanted, n of them, in the order of the numbers returned.
    topic
        Of JointState; `joint_states` if not given.

    Attributes
    ----------
    missing
        Wanted joints that no message has had so far.
    unknown
        Wanted joints without a position in the newest message: those that are not homed.
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
        """Return position, velocity, effort (3, n) [rad, rad/s, Nm], or None if nothing new came.

        What the message leaves empty is NaN; a state without positions is none.
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
        """Return the publisher's rate [Hz] over the last second, from its own numbering.

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


_STATES = 0  # its place among the topics


class StateStream:
    """Waits for joint states, IMU samples if wanted, and commands of rotors if any are named.

    Attributes
    ----------
    stamp_ns
        Stamp of the newest state [ns], None before the first.
    answers
        What is published in answer to the states.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    names
        Joint names, n of them, in the order of all arrays.
    reject
        Called with the reason why a message is not used.
    rotors
        Names of the rotors.
    depth
        How many states, and IMU samples, may wait. With more than 1, every state is given, the
        oldest first, and each IMU sample with the first state that came after it.
    imu
        Whether IMU samples are wanted. They end a wait, and must be taken then.
    odometry
        Whether the odometry is wanted, likewise.
    answered
        Whether each state wants an answer, see `Answers`.
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
        """States taken."""
        return self._reader.count(_STATES)

    @property
    def lost(self) -> int | None:
        """States missed since `begin_count`, None where the middleware does not number them."""
        lost = self._reader.lost(_STATES)
        return None if lost is None else lost - self._lost_before

    def begin_count(self) -> None:
        """Count from the state taken last on: those before were of no use to anybody."""
        self._lost_before = self._reader.lost(_STATES) or 0

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; ends early, with False, on a stop signal."""
        return self._reader.wait(timeout)

    def newest_state(self) -> tuple[int, ArmState] | None:
        """Return stamp [ns] and state of the newest message, None if there is none.

        With a depth, of the oldest that waits.
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
            self._reject('joint_states has no position or no velocity: check its publisher')
            return None
        self.stamp_ns = sample.stamp_ns
        return sample.stamp_ns, ArmState(q, dq, self._no_effort if tau is None else tau)

    def latency_ns(self) -> int:
        """Return how long ago, on this host, the newest state was published [ns].

        Its stamp does not tell that of an emulated arm, whose time is its own.
        """
        return time.time_ns() - self._published_ns

    def imu_samples(self) -> list[tuple[ImuSample, int]]:
        """Return the IMU samples that wait, each with its lead over the newest state [ns].

        The lead is negative for one that came after it. Faulty ones are rejected.
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
            try:
                sample = to_imu_sample(deserialize_message(payload, Imu))
            except RejectedInputError as error:
                self._reject(str(error))
            except RuntimeError as error:  # RMWError: no message at all
                self._reject(f'imu: {error}')
            else:
                samples.append((sample, self._received_ns - info['received_timestamp']))
        return samples

    def odometry(self) -> Odometry | None:
        """Return the newest odometry that waits, None if there is none."""
        if self._odometry_place is None:
            return None
        raw = self._reader.take_newest(self._odometry_place)
        return None if raw is None else decoded_odometry(raw[0], self._reject)

    def rotor_command(self) -> RotorThrusts | None:
        """Return the newest command of the rotors, None if none waits."""
        if self._rotors is None:
            return None
        message = self._reader.take_newest(self._rotors_place)
        if message is None:
            return None
        payload, info = message
        names, sample = self._rotors.names, self._rotors.unpack(payload)
        try:
            if sample is None:
                names, sample = decode_joint_state(payload)
        except ValueError as error:
            self._reject(f'rotor_command: {error}')
            return None
        if sample.effort is None:
            self._reject('rotor_command has no effort: send the thrust of each rotor [N] as effort')
            return None
        lead_ns = self._received_ns - info['received_timestamp']
        return RotorThrusts(names, sample.effort, sample.stamp_ns * 1e-9, lead_ns)

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()

    def _decode(self, payload: bytes) -> JointSample | None:
        """Read a state of another layout, joints by name."""
        try:
            names, sample = decode_joint_state(payload)
            return in_order(names, sample, self._names)
        except ValueError as error:
            self._reject(
                f'joint_states rejected, {error}; use the same config, urdf and tf_prefix for '
                'this node and the bridge'
            )
            return None


def decoded_odometry(payload: bytes, reject: Callable[[str], None]) -> Odometry | None:
    """Return the odometry of a serialized message, None if it is none, which is reported."""
    try:
        return deserialize_message(payload, Odometry)
    except RuntimeError as error:  # RMWError: no message at all
        reject(f'odometry: {error}')
        return None


def to_imu_sample(message: Imu) -> ImuSample:
    """Return a checked sample of a message; raises RejectedInputError."""
    q, w, f = message.orientation, message.angular_velocity, message.linear_acceleration
    # sensor_msgs/Imu: a negative first covariance says that there is no such measurement.
    absent = (message.angular_velocity_covariance, message.linear_acceleration_covariance)
    if any(covariance[0] < 0.0 for covariance in absent):
        raise RejectedInputError(
            'imu: angular velocity or acceleration is missing; check its publisher'
        )
    has_attitude = message.orientation_covariance[0] >= 0.0
    stamp = message.header.stamp
    return ImuSample(
        stamp.sec + 1e-9 * stamp.nanosec,
        np.array([q.x, q.y, q.z, q.w]) if has_attitude else None,
        np.array([w.x, w.y, w.z]),
        np.array([f.x, f.y, f.z]),
    )
