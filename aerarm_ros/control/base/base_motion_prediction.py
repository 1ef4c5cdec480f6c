"""The base's motion a little after it was measured."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion

Array = npt.NDArray[np.float64]

# How long a trend is believed [s]: over the age of a sample on a slow line, but not over a dropout,
# where its noise would count for more than what it says.
_TREND_TIME = 0.02


class BaseMotionPrediction:
    """Turns a measured motion on with the measured rate.

    What is constant in the world turns against the base: `dv/dt = -w x v` in base axes. At
    30 degrees and 0.5 Hz gravity turns by 1.6 mrad a millisecond, so an IMU of 250 Hz and the
    delay of a command would cost as much as the rest of a tracking error. The specific force
    follows its own trend where that is known: of a drone it is the thrust, which turns along. The
    trends of force and angular acceleration go on for 20 ms, then both stay.

    Parameters
    ----------
    measured : BaseMotion
    angular_velocity : (3,) ndarray
        Of the base, in base axes [rad/s]; that of `measured` is zero where the base is taken
        for still.
    force_slope : (3,) ndarray, optional
        Rate at which the specific force changes in the base [m/s^3]; without it the force is
        taken for constant in the world.
    jerk : (3,) ndarray, optional
        Rate at which the angular acceleration changes in the base [rad/s^3].
    """

    def __init__(
        self,
        measured: BaseMotion,
        angular_velocity: Array,
        force_slope: Array | None = None,
        jerk: Array | None = None,
    ) -> None:
        self._measured = measured
        x, y, z = angular_velocity.tolist()
        # v W = w x v for rows v; the first terms of v exp(-W t).
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        self._vectors = np.array(measured[:2])
        self._slopes = -self._vectors @ turn
        self._curvatures = -0.5 * self._slopes @ turn
        self._force_slope = force_slope
        self._jerk = np.zeros(3) if jerk is None else jerk

    def after(self, time: float) -> BaseMotion:
        """Return the motion `time` [s] after the measurement.

        What turns is exact to second order in the angle by which the base turns meanwhile.
        """
        if time == 0.0:
            return self._measured
        vectors = self._vectors + time * (self._slopes + time * self._curvatures)
        _, force, rate, spin = self._measured
        trend_time = min(max(time, -_TREND_TIME), _TREND_TIME)
        if self._force_slope is not None:
            vectors[1] = force + trend_time * self._force_slope
        change = trend_time * self._jerk
        # Beyond the trend's time the last acceleration goes on.
        rate = rate + time * (spin + change) - 0.5 * trend_time * change
        return BaseMotion(vectors[0], vectors[1], rate, spin + change)
