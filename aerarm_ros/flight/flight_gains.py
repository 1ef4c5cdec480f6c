"""How stiffly the drone is held."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import non_negative_number, positive


@dataclass(frozen=True)
class FlightGains:
    """Poles of position and attitude; the gains follow with mass and inertia.

    The attitude's loop closes through the rotors' lag, some 25 ms, so its frequency times that lag
    stays well below one; the position's loop closes through the attitude's, so it is some four
    times slower. Lift needs no lean: the height can be held more stiffly.

    Attributes
    ----------
    position_frequency, height_frequency, attitude_frequency : float
        Undamped natural frequency [rad/s]; that of the position is the horizontal one.
    position_damping, attitude_damping : float
        Damping ratio [-].
    position_integral, attitude_integral : float
        Rate at which what stays is integrated, as a share of the frequency [-].
    speed_max : float
        With which a far set point is approached [m/s].
    tilt_max : float
        Largest tilt that is asked for [rad].

    Raises
    ------
    ValueError
        If one isn't positive (an integral: is negative).
    """

    position_frequency: float = 2.0
    height_frequency: float = 3.0
    attitude_frequency: float = 9.0
    position_damping: float = 0.9
    attitude_damping: float = 0.8
    position_integral: float = 0.3
    attitude_integral: float = 0.2
    speed_max: float = 1.0
    tilt_max: float = 0.5

    def __post_init__(self) -> None:
        """Check every value."""
        for name, value in vars(self).items():
            if name.endswith('_integral'):
                non_negative_number(name, value)
            else:
                positive(name, value)

    @property
    def position_frequencies(self) -> npt.NDArray[np.float64]:
        """Those along the axes of the world, (3,) [rad/s]."""
        return np.array([self.position_frequency, self.position_frequency, self.height_frequency])
