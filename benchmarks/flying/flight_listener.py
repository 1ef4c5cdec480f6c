"""Subscriber to the messages of arm and drone in a flight."""

import time

import numpy as np
from builtin_interfaces.msg import Time
from flying.flight_record import FlightRecord
from flying.node_bench import PATIENCE
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.description.arm_config import load_arm_config

_STILL = 3e-4  # [m]
_NEAR = 1e-3  # [m] a sagged drone is also still at its turning point
_MANY = 125  # number of states in half a second


class FlightListener:
    """Received messages of arm and drone, with simulated time.

    Parameters
    ----------
    rotors : tuple of str
        Names of the rotors, empty without a flying drone.
    """

    def __init__(self, node: Node, rotors: tuple[str, ...] = ()) -> None:
        heard = [topics.JOINT_STATES, topics.TRUE_ODOMETRY, topics.ROTOR_COMMAND]
        self._reader = RawReader(node, *heard, topics.TRUE_WALL_FORCE)
        self._codec = JointStateCdr(load_arm_config().joint_names)
        self._rotor_codec = JointStateCdr(rotors or ('none',))
        self.forget()

    def next(self) -> tuple[float, np.ndarray]:
        """Return time [s] and joint angles of the next state."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            self._reader.wait(0.1)
            odometry, command = self._reader.take_newest(1), self._reader.take_newest(2)
            if odometry is not None:
                self._note(deserialize_message(odometry[0], Odometry))
            if (force := self._reader.take_newest(3)) is not None:
                message = deserialize_message(force[0], WrenchStamped)
                self.forces.append((_seconds(message.header.stamp), -message.wrench.force.x))
            thrust = self._rotor_codec.unpack(command[0]) if command else None
            if thrust is not None and thrust.effort is not None:
                self._commands.append((thrust.stamp_ns * 1e-9, np.array(thrust.effort)))
            message = self._reader.take_newest(0)
            sample = self._codec.unpack(message[0]) if message else None
            if sample is not None and sample.position is not None:
                self._joints.append((sample.stamp_ns * 1e-9, np.array(sample.position)))
                return self._joints[-1]
        raise TimeoutError(f'no joint states for {PATIENCE:g} s')

    def forget(self) -> None:
        """Discard the received messages."""
        self.farthest = 0.0
        self.forces: list[tuple[float, float]] = []  # [s], [N] on a wall
        self._joints: list[tuple[float, np.ndarray]] = []
        self._states: list[tuple[float, np.ndarray, np.ndarray]] = []
        self._commands: list[tuple[float, np.ndarray]] = []

    def is_still(self) -> bool:
        """Return whether the drone has been still at its place for half a second."""
        if len(self._states) <= _MANY:
            return False
        last = [state for state in self._states[-_MANY:] if state[0] > self._states[-1][0] - 0.5]
        places = np.array([place for _, place, _ in last])
        moved, away = float(np.ptp(places, axis=0).max()), float(np.linalg.norm(places[-1]))
        return moved < _STILL and away < _NEAR

    def record(self) -> FlightRecord:
        """Return the received messages as a record."""
        when, q = (np.array(column) for column in zip(*self._joints, strict=True))
        times, places, attitudes = (np.array(c) for c in zip(*self._states, strict=True))
        # Joint states arrive four times as often, so a few missed ones do not matter.
        postures = np.column_stack([np.interp(times, when, angle) for angle in q.T])
        stamps, thrusts = (np.array(column) for column in zip(*self._commands, strict=True))
        return FlightRecord(times, places, attitudes, postures, stamps, thrusts)

    def _note(self, message: Odometry) -> None:
        p, q = message.pose.pose.position, message.pose.pose.orientation
        place = np.array([p.x, p.y, p.z])
        self.farthest = max(self.farthest, float(np.linalg.norm(place)))
        self._states.append((_seconds(message.header.stamp), place, np.array([q.x, q.y, q.z, q.w])))

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()


def _seconds(stamp: Time) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec
