"""Prediction of a hovering drone's heading under the vertical moment of its arm."""

from itertools import pairwise
from math import acos, ceil, exp, pi, sqrt

import numpy as np

from aerarm_ros.control.checks import positive
from aerarm_ros.motion.signals import Array

_DAMPING = 0.8  # [-] of the drone's heading control
_SLOPE = _DAMPING / sqrt(1.0 - _DAMPING**2)
# Largest deviation of the heading, times frequency, per bounded rate L / I: twice the sum of the
# extrema of the response to a step of L / I.
_GAIN = 2.0 * exp(-_SLOPE * acos(_DAMPING)) / (1.0 - exp(-pi * _SLOPE))
_FED = 0.8  # known fraction of the arm's moment; the model is wrong by the rest
_TURN_SHARE = 0.4
_STEP = 0.2  # largest step of the integration, relative to 1 / frequency
_TAIL = 3.0  # observed time after the motion, relative to 1 / frequency


class HeadingControl:
    """Model of a drone's heading control with limited moment, and the accepted deviation.

    The vertical angular momentum p of drone and arm changes only by the rotors' moment u. With the
    momentum L of the arm, that of an unknown payload L_p, and the inertia I of drone and arm about
    the vertical, the heading psi is::

        dpsi = (p - L - L_p) / I
        dp   = u = 0.8 dL (if fed forward) - I_0 (2 zeta w dpsi + w^2 psi),    low <= u <= high

    Without a moment of the rotors the heading depends on the path of the arm alone and not on its
    speed. I_0 is the smallest inertia of the motion. zeta is 0.8. Delays of rotors and sensors are
    neglected. Of a moment that is fed forward, 20 % count as unknown, for errors of the model.

    Parameters
    ----------
    limit : float
        Largest deviation of the heading [rad].
    frequency : float
        Natural frequency w [rad/s].
    is_fed : bool
        Whether the drone's controller feeds the moment of the arm's motion forward.

    Raises
    ------
    ValueError
        If a number is not positive.
    """

    def __init__(self, limit: float, frequency: float = 2.0, is_fed: bool = False) -> None:
        self.limit = positive('limit', limit)
        self._frequency = positive('frequency', frequency)
        self._is_fed = is_fed

    @property
    def turn_max(self) -> float:
        """Largest momentum per inertia, |L| / I [rad/s], that never exceeds the heading limit.

        The bound is 0.4 times that of a linear system (integral of the magnitude of the impulse
        response). The fraction covers the limited moment of the rotors.
        """
        turn_max = _TURN_SHARE * self._frequency * self.limit / _GAIN
        return 2.0 * turn_max if self._is_fed else turn_max

    def excursion(
        self,
        times: Array,
        momentum: Array,
        inertia: Array,
        low: Array,
        high: Array,
        carried: Array | float = 0.0,
    ) -> float:
        """Return the heading's largest deviation [rad] during a motion and afterwards.

        Parameters
        ----------
        times : (M,) ndarray
            Increasing times from 0 [s].
        momentum : (M,) ndarray
            Angular momentum L of the arm about the vertical through the common centre of mass, on
            a base at rest [Nms].
        inertia : (M,) ndarray
            Inertia of drone and arm about that vertical [kg m^2].
        low, high : (M,) ndarray
            Smallest and largest moment of the rotors about the vertical, beside hovering and the
            other moments of the motion [Nm].
        carried : (M,) ndarray or float
            Angular momentum of the unknown payload [Nms], which is never fed forward.
        """
        w = self._frequency
        end = float(times[-1]) + _TAIL / w
        step = min(float(np.diff(times).min()), _STEP / w)
        grid = np.linspace(0.0, end, ceil(end / step) + 1)
        rows = [np.interp(grid, times, row) for row in (momentum, inertia, low, high)]
        known = _FED if self._is_fed else 0.0
        fed = known * np.diff(rows[0], append=rows[0][-1]) / grid[1]
        rows[0] = rows[0] + np.interp(grid, times, np.broadcast_to(carried, times.shape))
        least = float(inertia.min())
        return _largest(grid[1], least * w * w, 2.0 * _DAMPING * least * w, [*rows, fed])


def _largest(step: float, kp: float, kd: float, columns: list[Array]) -> float:
    """Return the largest heading |psi| [rad] of `HeadingControl` from rest, for a time step [s].

    The columns are L, I, the smallest and the largest moment, and the moment fed forward.
    """
    heading = momentum = largest = 0.0
    points = list(zip(*(column.tolist() for column in columns), strict=True))
    for (arm, body, low, high, fed), after in pairwise(points):
        rate = (momentum - arm) / body
        moment = fed - kp * heading - kd * rate
        momentum += step * max(low, min(high, moment))
        heading += 0.5 * step * (rate + (momentum - after[0]) / after[1])
        largest = max(largest, abs(heading))
    return largest
