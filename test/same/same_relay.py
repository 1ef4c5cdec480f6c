"""Relay between the emulated arm and a controller that records every byte, for `same.py`.

`fake_hardware` and a controller run as separate processes. A `Relay` passes states to the
controller and commands to the bridge, unchanged, and records both. The simulation waits for each
command, so the relay can pause it at a state while it publishes a reference. So each input arrives
at the controller before the same state in every run.
"""

import hashlib
import json
import struct
import time
from collections.abc import Callable, Mapping

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

PATIENCE = 120.0  # [s] of the host, longest wait
SETTLED = 0.4  # [s] of the host in which a published message arrives
WINDOW_NS = 250_000_000  # [ns] per digest
_REPEATED = 5  # states after which a simulation that publishes them at 20 Hz is paused
_POLL = 5e-5  # [s]
# Reliable: the middleware repeats lost messages, as far as the publisher still has them.
_DEEP = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
STATES, COMMANDS = 'relayed_states', 'relayed_commands'
Step = tuple[float, Callable[[], None]]


def stamp_ns(message: bytes) -> int:
    """Return the stamp of a serialized message that begins with a header [ns]."""
    seconds, nanoseconds = struct.unpack_from('<iI', message, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Kept:
    """Messages of a topic, one per stamp."""

    def __init__(self) -> None:
        self.messages: dict[int, bytes] = {}

    def add(self, message: bytes) -> bool:
        """Store a message; return whether its stamp is new."""
        stamp = stamp_ns(message)
        is_new = stamp not in self.messages
        self.messages.setdefault(stamp, message)
        return is_new

    def digests(self, begin_ns: int, end_ns: int) -> dict[str, object]:
        """Return the number of messages with stamps between two [ns], and digests by time.

        Both ends are excluded: the simulation pauses there, and a message may arrive before this
        process subscribes, or after it ends.
        """
        stamps = [stamp for stamp in sorted(self.messages) if begin_ns < stamp < end_ns]
        windows: dict[str, bytes] = {}
        for stamp in stamps:
            begin = 1e-9 * (stamp // WINDOW_NS * WINDOW_NS)
            window = f'from {begin:.2f} s'
            windows[window] = windows.get(window, b'') + self.messages[stamp]
        digests = {key: hashlib.sha256(data).hexdigest()[:12] for key, data in windows.items()}
        return {'digests': digests, 'messages': len(stamps)}


class Relay:
    """Pass states and commands on, store them, and pause the simulation at a state.

    Attributes
    ----------
    kept
        Messages by topic.
    stamp
        Stamp of the newest state [ns].
    mode
        Newest arm_mode.
    """

    def __init__(self, others: Mapping[str, type] | None = None) -> None:
        self._raw = rclpy.create_node('same_relay')
        self.node: Node = rclpy.create_node('same')
        topics = {'joint_states': JointState, 'motor_states': JointState, **(others or {})}
        topics[COMMANDS] = JointState
        self._readers = {
            topic: self._raw.create_subscription(kind, topic, print, _DEEP, raw=True)
            for topic, kind in topics.items()
        }
        self._states = self._raw.create_publisher(JointState, STATES, NEWEST)
        self._commands = self._raw.create_publisher(JointState, 'joint_command', NEWEST)
        self.kept = {topic: Kept() for topic in topics}
        self.stamp = 0
        self.mode = ''
        self.passes_on = False
        self._state = b''
        self._repeated = 0
        self._hold_at = 1 << 62
        self.node.create_subscription(String, 'arm_mode', self._on_mode, LATCHED)

    def _on_mode(self, message: String) -> None:
        self.mode = message.data

    def call(self, service: str) -> None:
        """Send a request to the bridge."""
        client = self.node.create_client(Trigger, f'fake_hardware/{service}')
        self.wait(client.service_is_ready, f'service {service}')
        future = client.call_async(Trigger.Request())
        self.wait(future.done, f'answer of {service}')
        if not future.result().success:
            raise RuntimeError(f'{service}: {future.result().message}')

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, and store the messages published meanwhile."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self.pump()
            rclpy.spin_once(self.node, timeout_sec=0.005)
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {PATIENCE:g} s for {what}; mode {self.mode}')

    def wait_until_standing(self, mode: str) -> None:
        """Wait until the simulation pauses in a mode, in which it repeats the last state."""
        self.wait(lambda: self.mode == mode, f'mode {mode}')
        self._repeated = 0
        self.wait(lambda: self._repeated >= _REPEATED, f'a state that is repeated in {mode}')

    def pump(self) -> bool:
        """Process received messages, and optionally pass them on. Return whether there were any."""
        came = False
        for topic, reader in self._readers.items():
            while (message := self._take(reader)) is not None:
                came = True
                is_new = self.kept[topic].add(message)
                if topic == 'joint_states':
                    self._on_state(message, is_new)
                elif topic == COMMANDS and stamp_ns(message) == self.stamp:
                    self._commands.publish(message)
        return came

    @staticmethod
    def _take(reader: Subscription) -> bytes | None:
        with reader.handle:
            taken = reader.handle.take_message(reader.msg_type, True)
        return None if taken is None else taken[0]

    def _on_state(self, message: bytes, is_new: bool) -> None:
        if is_new:
            self.stamp = max(self.stamp, stamp_ns(message))
            self._state = message
            self._repeated = 0
        else:
            self._repeated += 1
        if self.passes_on and not self._is_held():
            self._states.publish(message)

    def _is_held(self) -> bool:
        return self.stamp >= self._hold_at

    def run(self, steps: list[Step], end: float) -> tuple[int, int]:
        """Let the waiting controller command the arm from the paused state on.

        Parameters
        ----------
        steps
            Times [s] after that state and the actions at these times, in order.
        end
            End of the run [s].

        Returns
        -------
        Stamps of the first and of the last state [ns].
        """
        begin = self.stamp
        last = begin + round(end * 1e9)
        for offset, act in [*steps, (end, None)]:
            self._hold_at = begin + round(offset * 1e9)
            self._pass_on_until_held()
            if act is not None:
                act()
                self.settle()
        return begin, last

    def _pass_on_until_held(self) -> None:
        if self._is_held():
            return
        self.passes_on = True
        self._states.publish(self._state)
        self.pass_on_until(self._is_held)
        self.passes_on = False

    def settle(self) -> None:
        """Wait until published messages have arrived."""
        end, self._repeated = time.monotonic() + SETTLED, 0
        self.wait(
            lambda: self._repeated >= _REPEATED and time.monotonic() > end,
            'a state that is repeated',
        )

    def pass_on_until(self, condition: Callable[[], bool]) -> None:
        """Pass states and commands on until a condition holds."""
        stamp, deadline = self.stamp, time.monotonic() + PATIENCE
        while not condition():
            if not self.pump():
                time.sleep(_POLL)
            if self.stamp != stamp:
                stamp, deadline = self.stamp, time.monotonic() + PATIENCE
            if time.monotonic() > deadline:
                raise TimeoutError(f'no new state for {PATIENCE:g} s after that of {stamp} ns')

    def wait_for_recorder(self, topics: list[str]) -> None:
        """Wait until a recorder records topics."""
        matched: set[str] = set()

        def note(message: String) -> None:
            matched.update(json.loads(message.data).get('matched', ()))

        self.node.create_subscription(String, 'recorder_status', note, LATCHED)
        self.wait(lambda: matched >= {f'/{topic}' for topic in topics}, 'the recorder')

    def destroy(self) -> None:
        """Destroy both nodes."""
        self._raw.destroy_node()
        self.node.destroy_node()

    def publisher(self, kind: type, topic: str) -> Callable[[object], None]:
        """Return a function that publishes a message on a topic of the controller."""
        publisher = self.node.create_publisher(kind, topic, RELIABLE)
        self.wait(lambda: publisher.get_subscription_count() > 0, f'subscriber of {topic}')
        return publisher.publish

    def items(self, name: str, begin: int, end: int) -> dict[str, object]:
        """Return the digests of all topics."""
        return {
            f'lockstep/{name}/{"joint_command" if topic == COMMANDS else topic}': kept.digests(
                begin, end
            )
            for topic, kept in self.kept.items()
        }
