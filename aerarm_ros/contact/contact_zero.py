"""What is taken for contact while nothing touches, to be subtracted from then on."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

DURATION = 2.0
"""[s] over which it is averaged."""


class ContactZero:
    """Subtracts what a wrong model makes of weight and thrust.

    A wrong mass, or a thrust that is not as commanded, is a force that stays along the world's axes
    as long as the drone hovers; where it acts stays with the drone. So a mean force in the world
    and a mean moment in the axes of the arm's base are subtracted.
    """

    def __init__(self) -> None:
        self._force, self._moment = np.zeros(3), np.zeros(3)
        self._sum, self._time = np.zeros(6), 0.0
        self._is_averaging = False

    def begin(self) -> None:
        """Average what comes from now on; until that is done what was subtracted still is."""
        self._sum, self._time, self._is_averaging = np.zeros(6), 0.0, True

    def apply(self, wrench: Array, rotation: Array, dt: float) -> Array:
        """Return a wrench (6,) in base axes, about the base's origin, without what is subtracted.

        Parameters
        ----------
        wrench : (6,) ndarray
            [N], [Nm]
        rotation : (3, 3) ndarray
            Of the base in the world.
        dt : float
            Since the last one [s].
        """
        force = rotation @ wrench[:3]
        if self._is_averaging:
            self._sum = self._sum + dt * np.concatenate([force, wrench[3:]])
            self._time += dt
            if self._time >= DURATION:
                self._force, self._moment = np.split(self._sum / self._time, 2)
                self._is_averaging = False
        return np.concatenate([(force - self._force) @ rotation, wrench[3:] - self._moment])
