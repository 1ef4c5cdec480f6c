"""The base's motion a little after it was measured."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base_motion import BaseMotion

Array = npt.NDArray[np.float64]


class BaseMotionPrediction:
    """Turns a measured motion on with the measured rate.

    What is constant in the world turns against the base: `dv/dt = -w x v` in base axes. At
    30 degrees and 0.5 Hz gravity turns by 1.6 mrad a millisecond, so an IMU of 250 Hz and the
    delay of a command would cost as much as the rest of a tracking error. Beside that turn the
    specific force changes with `surge`, the angular acceleration with `jerk`.

    Parameters
    ----------
    measured : BaseMotion
    angular_velocity : (3,) ndarray
        Of the base, in base axes [rad/s]; that of `measured` is zero where the base is taken
        for still.
    surge : (3,) ndarray, optional
        Rate of the specific force in the world, in base axes [m/s^3].
    jerk : (3,) ndarray, optional
        Rate of the angular acceleration in the base [rad/s^3].
    """

    def __init__(
        self,
        measured: BaseMotion,
        angular_velocity: Array,
        surge: Array | None = None,
        jerk: Array | None = None,
    ) -> None:
        self._measured = measured
        x, y, z = angular_velocity.tolist()
        # v W = w x v for rows v; the first terms of v exp(-W t).
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        self._vectors = np.array(measured[:2])
        self._slopes = -self._vectors @ turn
        self._curvatures = -0.5 * self._slopes @ turn
        if surge is not None:
            self._slopes[1] += surge
        self._jerk = np.zeros(3) if jerk is None else jerk

    def after(self, time: float) -> BaseMotion:
        """Return the motion `time` [s] after the measurement.

        It is exact to second order in the angle by which the base turns meanwhile.
        """
        if time == 0.0:
            return self._measured
        vectors = self._vectors + time * (self._slopes + time * self._curvatures)
        _, _, rate, spin = self._measured
        change = time * self._jerk
        return BaseMotion(
            vectors[0], vectors[1], rate + time * (spin + 0.5 * change), spin + change
        )
