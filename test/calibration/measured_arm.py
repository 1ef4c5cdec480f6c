"""An emulated arm with manufacturing deviations, measured by a motion capture."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.calibration.chain import Chain, chain_of
from aerarm_ros.calibration.observations import MarkerSource, Observations
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters
from aerarm_ros.simulation.made_geometry import MadeGeometry
from aerarm_ros.simulation.mocap import EmulatedMocap

ROBOT = load_robot()
CONFIG = load_arm_config()
LINK = ROBOT.link_names[-1]


def own_chain() -> Chain:
    """Return the packaged arm's chain."""
    return chain_of(ROBOT.urdf_text, ROBOT.joint_names, '', (), CONFIG.gravity_in_base)


@dataclass(eq=False)
class MeasuredArm:
    """A manufactured arm and its motion capture.

    Parameters
    ----------
    seed : int
    frames : int
        Number of frames in a posture's mean.
    dropout : float
        Probability that the motion capture misses a marker.
    """

    seed: int
    frames: int = 1
    dropout: float = 0.05

    def __post_init__(self) -> None:
        self.made = MadeGeometry.of(ROBOT, self.seed)
        parameters = PlantParameters.nominal(CONFIG, self.made.robot)
        self.plant = ArmPlant(self.made.robot, parameters)
        self.mocap = EmulatedMocap(LINK, self.seed, dropout=self.dropout)

    def put(self, q: np.ndarray) -> None:
        """Move the arm until its encoders show a posture."""
        self.plant.reset(q + self.made.offsets)

    def postures(self, count: int, seed: int = 0) -> np.ndarray:
        """Return random postures (count, n) within the limits."""
        low, high = ROBOT.posture_range
        return np.random.default_rng([self.seed, seed]).uniform(low, high, (count, ROBOT.n))

    def observe(self, q: np.ndarray) -> Observations:
        """Return motion capture measurements of postures, with the recorded encoder angles."""
        position = np.full((len(q), len(self.mocap.names), 3), np.nan)
        for k, row in enumerate(q):
            self.put(row)
            frames = np.array([self.mocap.read(self.plant) for _ in range(self.frames)])
            seen = np.isfinite(frames[..., 0]).any(axis=0)
            position[k, seen] = np.nanmean(frames[:, seen], axis=0)
        return Observations(q, (MarkerSource('mocap', self.mocap.names, position),))

    def true_positions(self, q: np.ndarray) -> np.ndarray:
        """Return the true positions of the markers (M, K, 3), without noise."""
        found = []
        for row in q:
            self.put(row)
            found.append(self.mocap.true_positions(self.plant))
        return np.array(found)

    def true_observations(self, q: np.ndarray) -> Observations:
        """Return complete measurements without noise, for residuals of held-out postures."""
        return Observations(q, (MarkerSource('mocap', self.mocap.names, self.true_positions(q)),))
