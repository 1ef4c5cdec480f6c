"""Recorded data of a flight, the errors computed from them, and the subscriber that records."""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from flying.node_bench import PATIENCE
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import JointMotion

LOST = 1.0  # [m] error above which the drone is lost
_AT_LIMIT = 1e-6  # relative to the largest thrust


class FlightFigures(NamedTuple):
    """RMS and maximum of drone position error [mm], tilt [deg] and tool position error [mm].

    `heading_max` is the largest rotation about the vertical [deg], `limited` the fraction of time
    in which a rotor is at a limit [%].
    """

    place: float
    place_max: float
    tilt: float
    tilt_max: float
    heading_max: float
    tool: float
    tool_max: float
    limited: float


@dataclass(frozen=True, eq=False)
class FlightRecord:
    """Recorded motion of drone and arm, with world time.

    Attributes
    ----------
    times : (K,) ndarray
        Times of the drone's states [s].
    places : (K, 3) ndarray
        Positions of the drone's body [m]; the target is the origin.
    attitudes : (K, 4) ndarray
        Quaternions (x, y, z, w).
    postures : (K, n) ndarray
        Joint angles at these times [rad].
    command_times : (L,) ndarray
        Times of the rotor commands [s].
    thrusts : (L, m) ndarray
        Commanded thrusts [N].
    """

    times: np.ndarray
    places: np.ndarray
    attitudes: np.ndarray
    postures: np.ndarray
    command_times: np.ndarray
    thrusts: np.ndarray

    @property
    def tilts(self) -> np.ndarray:
        """Tilt angles between the body's z axis and the vertical, (K,) [rad]."""
        x, y = self.attitudes[:, 0], self.attitudes[:, 1]
        return np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))

    @property
    def headings(self) -> np.ndarray:
        """Rotations about the vertical, (K,) [rad]."""
        return Rotation.from_quat(self.attitudes).as_euler('ZYX')[:, 0]

    @property
    def is_lost(self) -> bool:
        """Whether the drone left its place."""
        return bool(np.linalg.norm(self.places, axis=1).max() > LOST)

    def part(self, begin: float, end: float) -> 'FlightRecord':
        """Return the data between two times [s]."""
        rows = (self.times >= begin) & (self.times < end)
        commands = (self.command_times >= begin) & (self.command_times < end)
        states = (self.times, self.places, self.attitudes, self.postures)
        thrusts = (self.command_times, self.thrusts)
        return FlightRecord(*(x[rows] for x in states), *(x[commands] for x in thrusts))

    def shifted(self, begin: float) -> 'FlightRecord':
        """Return the record with times relative to a given time [s]."""
        return replace(self, times=self.times - begin, command_times=self.command_times - begin)

    def largest_joint_error(self, motion: JointMotion) -> float:
        """Return the largest joint error during a motion that began at time 0 [rad]."""
        moving = (self.times >= 0.0) & (self.times <= motion.duration)
        wanted = motion.evaluate(self.times[moving]).q
        return float(np.abs(self.postures[moving] - wanted).max(initial=0.0))

    def figures(self, motion: JointMotion, drone: DroneConfig) -> FlightFigures | None:
        """Return the figures of a flight, None if the drone was lost.

        Parameters
        ----------
        motion : JointMotion
            Commanded motion of the arm, starting at time 0.
        """
        away = 1e3 * np.linalg.norm(self.places, axis=1)
        if not len(away) or away.max() > 1e3 * LOST:
            return None
        tool = 1e3 * np.linalg.norm(self._tool_errors(motion, drone), axis=1)
        tilt = np.degrees(self.tilts)
        low, high = drone.column('thrust_min'), drone.column('thrust_max')
        room = np.minimum(self.thrusts - low, high - self.thrusts)
        limited = 100.0 * float(np.mean(np.any(room < _AT_LIMIT * high, axis=1)))
        place, tilted, reached = [(_rms(x), float(x.max())) for x in (away, tilt, tool)]
        heading = float(np.degrees(np.abs(self.headings).max()))
        return FlightFigures(*place, *tilted, heading, *reached, limited)

    def _tool_errors(self, motion: JointMotion, drone: DroneConfig) -> np.ndarray:
        """Return the tool's distance from its position under a drone at its place [m]."""
        wanted = motion.evaluate(np.maximum(self.times, 0.0)).q
        return self.tools(drone) - _tools_on_body(drone, wanted)

    def tools(self, drone: DroneConfig) -> np.ndarray:
        """Return the positions of the tool in the world (K, 3) [m]."""
        on_body = _tools_on_body(drone, self.postures)
        return self.places + Rotation.from_quat(self.attitudes).apply(on_body)


def _tools_on_body(drone: DroneConfig, postures: np.ndarray) -> np.ndarray:
    kinematics = Kinematics(load_robot())
    on_mount = np.array([kinematics.position(q) for q in postures])
    return drone.mount.position + on_mount @ drone.mount.rotation.T


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


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
