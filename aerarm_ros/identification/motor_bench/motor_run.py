"""One stretch of motion on the motor bench, of the one joint that moves."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.motor_bench.motor_blocks import MotorBlocks

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotorRun:
    """Measured motion of a joint while the others stand still.

    Attributes
    ----------
    speed : float or None
        Commanded velocity, signed [rad/s]; None in an acceleration run and in swings.
    time : (M,) ndarray
        Rising [s].
    q, dq, tau : (M,) ndarray
        [rad], [rad/s], and the torque of the measured current [Nm], at the joint.
    swings : bool
        Whether the joint swings about the posture, for the gear's play.
    """

    speed: float | None
    time: Array
    q: Array
    dq: Array
    tau: Array
    swings: bool = False

    def blocks(self, length: float) -> MotorBlocks:
        """Return means over blocks of `length` [s]: noise is averaged, ripple of gears too."""
        since = self.time - self.time[0]
        index = (since / length).astype(int)
        index = np.minimum(index, max(index[-1] - 1, 0))  # the rest belongs to the last block
        count = np.maximum(np.bincount(index), 1)

        def mean(values: Array) -> Array:
            return np.asarray(np.bincount(index, weights=values) / count)

        # Slope of a straight line through the velocities of each block.
        offset = since - mean(since)[index]
        spread = np.maximum(mean(offset**2), 1e-12)
        return MotorBlocks(
            speed=self.speed,
            sine=mean(np.sin(self.q)),
            cosine=mean(np.cos(self.q)),
            dq=mean(self.dq),
            ddq=mean(offset * self.dq) / spread,
            tau=mean(self.tau),
        )
