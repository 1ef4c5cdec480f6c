"""What the rotors give, from what they were commanded."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import DroneConfig

Array = npt.NDArray[np.float64]


class RotorEstimate:
    """Thrusts that follow commands with each rotor's first-order lag.

    Parameters
    ----------
    drone : DroneConfig
    """

    def __init__(self, drone: DroneConfig) -> None:
        self._allocation = drone.allocation
        self._time_constant = drone.column('time_constant')
        self._command: Array | None = None
        self._thrust = np.zeros(drone.n)

    def reset(self) -> None:
        """Forget what was commanded."""
        self._command = None

    def command(self, thrust: Array) -> None:
        """Take the commanded thrusts (n,) [N]; the first are taken as given."""
        if self._command is None:
            self._thrust = thrust
        self._command = thrust

    def advance(self, dt: float) -> Array:
        """Return the mean wrench (6,) on the body over the next `dt` [s], about its origin."""
        if self._command is None:
            return np.asarray(self._allocation @ self._thrust)
        before = self._thrust
        gain = 1.0 - np.exp(-dt / self._time_constant)
        self._thrust = before + gain * (self._command - before)
        return np.asarray(self._allocation @ (0.5 * (before + self._thrust)))
