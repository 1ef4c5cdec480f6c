"""What the bridge lets the joints be asked, in arrays that every cycle writes anew."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class CommandBuffer:
    """References of n joints, one by one; NaN where a quantity is unused.

    A controller's `JointCommand` says for all joints at once what is unused. Here each joint
    has its own mode, and the arrays stay: what is let in, limited and followed is written into
    them in every cycle. What is given for a joint chooses its mode: effort alone is torque
    control, velocity alone the boards' PI velocity loop (thesis (4.5)), position with velocity
    and effort the boards' full law (4.4) with feed-forward.

    Attributes
    ----------
    q, dq, tau
        (n,) positions [rad], velocities [rad/s], efforts [Nm].
    """

    __slots__ = ('dq', 'q', 'tau')

    def __init__(self, n: int) -> None:
        self.q: Array = np.full(n, np.nan)
        self.dq: Array = np.full(n, np.nan)
        self.tau: Array = np.full(n, np.nan)

    @classmethod
    def standstill(cls, n: int) -> 'CommandBuffer':
        """Return zero velocity for every joint: stay where you are."""
        command = cls(n)
        command.dq[:] = 0.0
        return command
