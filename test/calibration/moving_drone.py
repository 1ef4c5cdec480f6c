"""Recordings of a moving drone with noisy sensors and a manufactured mount."""

import numpy as np
from measured_arm import CONFIG, LINK, ROBOT

from aerarm_ros.calibration.plateaus import Track
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters
from aerarm_ros.simulation.made_geometry import MadeGeometry, rotation_about
from aerarm_ros.simulation.mocap import MARKERS

G = np.array([0.0, 0.0, -9.81])


class MovingDrone:
    """A drone and its arm on sine waves, with noisy sensors.

    Parameters
    ----------
    seed : int
    turn, tilt : float
        Amplitude of the drone's rotations, and tilt of the measured world [rad].
    made : bool
        Whether the arm has manufacturing errors, not only its mount and the IMU.
    duration : float
        Duration of the recordings [s].
    """

    def __init__(
        self,
        seed: int,
        turn: float = 0.35,
        tilt: float = 0.0,
        made: bool = False,
        duration: float = 20.0,
    ) -> None:
        self._duration = duration
        self.world = rotation_about(tilt * np.array([0.6, -0.8, 0.0]))
        self.random = np.random.default_rng(seed)
        self.made = MadeGeometry.of(ROBOT, seed)
        self.drone = self.made.drone(load_drone_config())
        self._waves = self.random.uniform(0.3, 0.9, (2, 3, 3))
        self._phases = self.random.uniform(0.0, 6.0, (2, 3, 3))
        self._turn = turn
        robot = self.made.robot if made else ROBOT
        self.offsets = self.made.offsets if made else np.zeros(ROBOT.n)
        self.plant = ArmPlant(robot, PlantParameters.nominal(CONFIG, robot))

    def _sines(self, kind: int, t: float) -> np.ndarray:
        return np.sin(2.0 * np.pi * self._waves[kind] * t + self._phases[kind]).sum(axis=1)

    def place(self, t: float) -> np.ndarray:
        return 0.12 * self._sines(0, t) + (0.0, 0.0, 1.5)

    def rotation(self, t: float) -> np.ndarray:
        return rotation_about(self._turn * self._sines(1, t))

    def q(self, t: float) -> np.ndarray:
        return np.array([1.0, 1.2, 0.8, 0.9]) * np.sin(
            2.0 * np.pi * np.array([0.11, 0.17, 0.23, 0.31]) * t
        ) + (0.0, 1.4, 0.2, -0.3)

    def body(self, late: float = 0.0) -> Track:
        """Return the pose from a motion capture: 0.2 mm, 0.6 mrad, 100 Hz."""
        time = np.arange(0.0, self._duration, 0.01)
        place = np.array([self.place(t) for t in time])
        turn = np.array(
            [self.rotation(t) @ rotation_about(0.6e-3 * self.random.normal(size=3)) for t in time]
        )
        place += 0.2e-3 * self.random.normal(size=place.shape)
        return Track('drone', time + late, place @ self.world.T, self.world @ turn)

    def marker_places(self, t: float) -> np.ndarray:
        """Return the true positions (K, 3) of the markers in the world [m]."""
        mount = self.drone.mount
        self.plant.reset(self.q(t) + self.offsets)
        rotation, place = self.plant.link_pose(LINK)
        in_base = place + np.array(MARKERS) @ rotation.T
        in_body = np.array(mount.position) + in_base @ mount.rotation.T
        return self.place(t) + in_body @ self.rotation(t).T

    def markers(self) -> list[Track]:
        time = np.arange(0.0, self._duration, 0.01)
        found = np.array([self.marker_places(t) for t in time])
        found += 0.2e-3 * self.random.normal(size=found.shape)
        return [Track(f'm{k}', time, found[:, k]) for k in range(len(MARKERS))]

    def joints(self, late: float) -> tuple[np.ndarray, np.ndarray]:
        time = np.arange(0.0, self._duration, 0.002)
        return time + late, np.array([self.q(t) for t in time])

    def imu(self, late: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the IMU's measurements at its place: noise, bias, 250 Hz."""
        time = np.arange(0.5, self._duration - 0.5, 0.004)
        h, lever = 1e-4, np.array(self.drone.imu.position)
        rates, forces = [], []
        for t in time:
            before, now, after = (self.rotation(t + s) for s in (-h, 0.0, h))
            skew = now.T @ (after - before) / (2.0 * h)
            rates.append([skew[2, 1], skew[0, 2], skew[1, 0]])
            places = [self.place(t + s) + self.rotation(t + s) @ lever for s in (-h, 0.0, h)]
            acceleration = (places[0] - 2.0 * places[1] + places[2]) / h**2
            forces.append(now.T @ (acceleration - G))
        turn = self.drone.imu.rotation
        rate = np.array(rates) @ turn + 0.01 + 0.003 * self.random.normal(size=(len(time), 3))
        force = np.array(forces) @ turn + (0.05, -0.04, 0.03)
        return time + late, rate, force + 0.05 * self.random.normal(size=force.shape)


def angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arccos(np.clip(0.5 * (np.trace(one.T @ other) - 1.0), -1.0, 1.0)))
