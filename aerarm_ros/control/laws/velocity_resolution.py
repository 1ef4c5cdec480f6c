"""From a velocity of the tool to velocities of the joints."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import finite, non_negative_number, positive
from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.laws.damped_inverse import DampedInverse
from aerarm_ros.model.kinematics import Kinematics

Array = npt.NDArray[np.float64]


class VelocityResolution:
    """Inverse differential kinematics of a position task, thesis (2.8).

    The joint velocity that gives the frame's origin the wanted velocity; the motion it
    leaves free draws the arm toward a home configuration, and down an objective. Near its limits a
    joint may approach them only in proportion to the distance left (Faverjon, Tournassoud
    1987). A joint at that bound is fixed and the others take over its part (Flacco, De Luca,
    Khatib 2012). If a joint is then still too fast, all are slowed down alike: the tool keeps its
    direction.

    Parameters
    ----------
    kinematics : Kinematics
    limits : JointLimits
    rest : (n,) array_like
        [rad]
    inverse : DampedInverse
    rest_gain : float
        [1/s]
    limit_gain : float
        [1/s]: speed toward a limit over distance from it.
    margin : float
        Distance [rad] from the limits that is kept.
    slope : callable, optional
        Returns an objective's derivative by the joints (n,) at q (n,), such as that of the loss of
        holding the arm's weight [W/rad].
    slope_gain : float
        Speed down the objective [rad/s] over its slope.

    Attributes
    ----------
    least_singular_value : float
        Of the last Jacobian [m/rad]: how far from singular the arm is.
    slowdown : float
        Part of the wanted velocity that was given last, 0 .. 1.

    Raises
    ------
    ValueError
        If a gain is negative or the home configuration hasn't n joints.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        limits: JointLimits,
        rest: npt.ArrayLike,
        inverse: DampedInverse,
        rest_gain: float = 0.5,
        limit_gain: float = 5.0,
        margin: float = 0.02,
        slope: Callable[[Array], Array] | None = None,
        slope_gain: float = 0.0,
    ) -> None:
        self.kinematics = kinematics
        self._limits = limits
        self._rest = finite('rest', rest, limits.n)
        self._inverse = inverse
        self._rest_gain = non_negative_number('rest_gain', rest_gain)
        self._limit_gain = positive('limit_gain', limit_gain)
        margin = non_negative_number('margin', margin)
        self._slope = slope
        self._slope_gain = non_negative_number('slope_gain', slope_gain)
        self._low = limits.position_min + margin
        self._high = limits.position_max - margin
        self.least_singular_value = np.inf
        self.slowdown = 1.0

    def resolve(self, q: Array, velocity: Array) -> Array:
        """Return joint velocities (n,) [rad/s].

        Parameters
        ----------
        q : (n,) ndarray
            [rad]
        velocity : (3,) ndarray
            Of the frame's origin, in base axes [m/s].
        """
        jacobian = self.kinematics.position_jacobian(q)
        preferred = self._rest_gain * (self._rest - q)
        if self._slope is not None:
            preferred = preferred - self._slope_gain * self._slope(q)
        low = self._limit_gain * (self._low - q)
        high = self._limit_gain * (self._high - q)
        dq = self._within_bounds(jacobian, velocity, preferred, low, high)
        fastest = float((np.abs(dq) / self._limits.velocity_max).max()) + 1e-9
        self.slowdown = min(1.0, 1.0 / fastest)
        return self.slowdown * dq

    def _within_bounds(
        self, jacobian: Array, velocity: Array, preferred: Array, low: Array, high: Array
    ) -> Array:
        """Solve, fixing one joint after the other at the bound it violates most."""
        result = self._inverse.of(jacobian)
        self.least_singular_value = result.least
        dq: Array = result.inverse @ velocity + result.null_space @ preferred
        excess = np.maximum(dq - high, low - dq)
        if excess.max() <= 0.0:
            return dq
        free = jacobian.copy()
        fixed = np.zeros_like(preferred)
        is_free = np.ones(len(preferred), dtype=bool)
        while np.any(excess > 0.0):
            worst = int(np.argmax(excess))
            fixed[worst] = min(max(dq[worst], low[worst]), high[worst])
            is_free[worst] = False
            free[:, worst] = 0.0
            result = self._inverse.of(free)
            wanted = np.where(is_free, preferred, 0.0)
            dq = result.inverse @ (velocity - jacobian @ fixed) + result.null_space @ wanted
            dq = np.where(is_free, dq, fixed)
            excess = np.where(is_free, np.maximum(dq - high, low - dq), -np.inf)
        return dq
