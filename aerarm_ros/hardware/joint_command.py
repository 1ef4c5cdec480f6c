"""What a controller asks of the joints."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class JointCommand:
    """References of n joints; NaN where a quantity is unused.

    What is given for a joint chooses its mode: effort alone is torque control, velocity
    alone the boards' PI velocity loop (thesis (4.5)), position with velocity and effort the
    boards' full law (4.4) with feed-forward.

    Attributes
    ----------
    position, velocity, effort
        (n,) [rad], [rad/s], [Nm].
    """

    __slots__ = ('effort', 'position', 'velocity')

    def __init__(self, n: int) -> None:
        self.position: Array = np.full(n, np.nan)
        self.velocity: Array = np.full(n, np.nan)
        self.effort: Array = np.full(n, np.nan)

    @classmethod
    def standstill(cls, n: int) -> 'JointCommand':
        """Return zero velocity for every joint: stay where you are."""
        command = cls(n)
        command.velocity[:] = 0.0
        return command
