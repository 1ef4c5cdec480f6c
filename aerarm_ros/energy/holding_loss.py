"""What it costs to stand still."""

import numpy as np

from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.float_array import FloatArray


class HoldingLoss:
    """Copper loss of the torques that hold the arm's weight, thesis (4.1) at rest.

    Parameters
    ----------
    model : EnergyModel
    """

    def __init__(self, model: EnergyModel) -> None:
        self._dynamics = model.dynamics
        self._drives = model.drives
        self._rest = np.zeros(model.n)

    def watts(self, q: FloatArray) -> float:
        """Return the loss at q (n,) [rad] in watts."""
        return float(self._drives.copper(self._dynamics.gravity(q)).sum())

    def gradient(self, q: FloatArray) -> FloatArray:
        """Return its derivative by q, (n,) [W/rad]."""
        rest = self._rest
        weight, slopes, _, _ = self._dynamics.inverse_with_slopes(q, rest, rest)
        gradient: FloatArray = 2.0 * (self._drives.copper_per_torque2 * weight) @ slopes
        return gradient
