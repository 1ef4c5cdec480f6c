"""Recorded data of a flight, and the errors computed from them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

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
