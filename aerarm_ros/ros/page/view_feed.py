"""What the page hears of the arm, as often as a person can see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.float64_array_cdr import Float64ArrayCdr
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.ros.page.view_history import ViewHistory
from aerarm_ros.ros.states.state_sampler import StateSampler

Array = NDArray[np.float64]

# Rows of what is kept of each joint.
ROWS = ('q', 'dq', 'tau', 'q_ref', 'dq_ref', 'tau_ref', 'current', 'power')
BASE_ROWS = ('x [m]', 'y [m]', 'z [m]', 'roll [rad]', 'pitch [rad]', 'yaw [rad]')
_SILENT = 1.0  # [s] without states that is told
_STALE = 0.3  # [s] after which a reference, a current or a power counts as none


class ViewFeed:
    """Samples states, references, currents, powers and the base's pose, and keeps the last seconds.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    names
        Joint names, n of them.
    duration
        Time kept [s].
    rate
        Samples a second.
    has_base
        Whether the base moves, as `odometry` says.

    Attributes
    ----------
    joints, base
        Histories of `ROWS` (8, n), and of `BASE_ROWS` (6,).
    posture
        (n,) newest joint positions [rad], None before the first.
    pose
        Newest position (3,) [m] and unit quaternion (4,), real part first, of the base, or None.
    """

    def __init__(
        self, node: Node, names: Sequence[str], duration: float, rate: float, has_base: bool
    ) -> None:
        n = len(names)
        self.joints = ViewHistory((len(ROWS), n), duration, rate)
        self.base = ViewHistory((len(BASE_ROWS),), duration, rate)
        self.posture: Array | None = None
        self.pose: tuple[Array, Array] | None = None
        self._states = StateSampler(node, names)
        self._commands = StateSampler(node, names, topics.JOINT_COMMAND)
        self._motors = StateSampler(node, names, topics.MOTOR_STATES)
        self._powers = RawReader(node, topics.MOTOR_POWER)
        self._power_cdr = Float64ArrayCdr(n)
        self._row = np.full((len(ROWS), n), np.nan)
        self._heard = np.full(4, -np.inf)  # states, commands, motors, powers
        self._odometry: Odometry | None = None
        if has_base:
            topic = topics.ODOMETRY
            node.create_subscription(topic.type, topic.name, self._on_odometry, topic.qos)

    def update(self, now: float) -> bool:
        """Take what is new at the monotonic time `now` [s]; return whether the arm has moved on."""
        self._take_rest(now)
        self._take_pose(now)
        state = self._states.newest()
        if state is None:
            return False
        self._heard[0] = now
        self.posture = state[0]
        self._row[:3] = state
        self.joints.add(now, self._row)
        return True

    def describe(self, now: float) -> str:
        """Say what comes, or what is waited for."""
        missing = self._states.missing
        if missing:
            return (
                f'joint_states lacks {", ".join(missing)}: another arm? (config, urdf, tf_prefix)'
            )
        if self._states.unknown:
            names = ', '.join(self._states.unknown)
            return (
                f'the angle of {names} is unknown until the arm is homed: the picture is not true'
            )
        silent = now - self._heard[0]
        if not np.isfinite(silent):
            return 'no joint_states in this ROS domain: start a bridge, check ROS_DOMAIN_ID'
        if silent > _SILENT:
            return f'the last joint_states came {silent:.0f} s ago'
        return f'joint_states at {self._states.frequency(now):.0f} Hz'

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        for reader in (self._states, self._commands, self._motors, self._powers):
            reader.destroy()

    def _take_rest(self, now: float) -> None:
        command, motors = self._commands.newest(), self._motors.newest()
        if command is not None:
            self._row[3:6] = command
            self._heard[1] = now
        if motors is not None:
            self._row[6] = motors[2]
            self._heard[2] = now
        message = self._powers.take_newest()
        power = None if message is None else self._power_cdr.unpack(message[0])
        if power is not None:
            self._row[7] = power
            self._heard[3] = now
        old = now - self._heard[1:] > _STALE
        self._row[3:6][:, :] = np.nan if old[0] else self._row[3:6]
        self._row[6:][old[1:]] = np.nan

    def _take_pose(self, now: float) -> None:
        message, self._odometry = self._odometry, None
        if message is None:
            return
        p, q = message.pose.pose.position, message.pose.pose.orientation
        place, turn = np.array([p.x, p.y, p.z]), np.array([q.w, q.x, q.y, q.z])
        if np.all(np.isfinite([*place, *turn])) and np.any(turn):
            turn /= np.linalg.norm(turn)
            self.pose = place, turn
            self.base.add(now, np.concatenate([place, _angles(turn)]))

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message


def _angles(wxyz: Array) -> Array:
    """Return roll, pitch and yaw [rad] of a unit quaternion."""
    w, x, y, z = wxyz
    return np.array(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )
