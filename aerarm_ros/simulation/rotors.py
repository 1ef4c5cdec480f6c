"""The rotors of a simulated drone."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerarm_ros.description.drone_config import DroneConfig

Array = NDArray[np.float64]


class Rotors:
    """Thrusts that follow commands with a first-order lag, within limits.

    The controllers of the motors stop them when no command came for a time, as those of a drone
    do: the rotors spin down. The moment with which a propeller itself speeds up is left out, and
    so is what the air does to a propeller that moves through it.

    Parameters
    ----------
    drone : DroneConfig
    substep : float
        Time between two calls of `step` [s].
    timeout : float
        Silence after which the rotors are stopped [s].

    Attributes
    ----------
    thrust : (n,) ndarray
        What the rotors give [N].
    """

    def __init__(self, drone: DroneConfig, substep: float, timeout: float) -> None:
        self._allocation = drone.allocation
        self._min, self._max = drone.column('thrust_min'), drone.column('thrust_max')
        self._gain = 1.0 - np.exp(-substep / drone.column('time_constant'))
        self._stopped = np.clip(0.0, self._min, self._max)
        self._substep = substep
        self._timeout = timeout
        self.stop()

    @property
    def is_commanded(self) -> bool:
        """Whether a command came lately."""
        return self._silence <= self._timeout

    @property
    def time_commanded(self) -> float:
        """How long commands have come without such a silence between [s]."""
        return self._commanded_for

    def command(self, thrust: ArrayLike) -> None:
        """Take wanted thrusts (n,) [N]; each rotor gives what it can."""
        self._target = np.clip(np.asarray(thrust, dtype=float), self._min, self._max)
        self._silence = 0.0

    def stop(self) -> None:
        """Let the rotors stand, as if no command had ever come."""
        self.thrust = self._stopped.copy()
        self._target = self._stopped
        self._silence = np.inf
        self._commanded_for = 0.0

    def step(self) -> Array:
        """Advance by a sub-step; return the wrench (6,) on the body at its frame's origin."""
        self._silence += self._substep
        if self._silence > self._timeout:
            self._target = self._stopped
            self._commanded_for = 0.0
        else:
            self._commanded_for += self._substep
        self.thrust += self._gain * (self._target - self.thrust)
        wrench: Array = self._allocation @ self.thrust
        return wrench
