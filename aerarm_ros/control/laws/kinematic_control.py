"""Velocity control of joints or tool with a damped inverse of the Jacobian."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks import (
    JointLimits,
    finite,
    non_negative,
    non_negative_number,
    positive,
)
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, TaskReference


class DampedInverse:
    """Damped pseudo-inverse of a Jacobian, which stays finite at singularities.

    Each singular value s is inverted as `s / (s^2 + d^2)`, with a damping that grows from zero at
    `threshold` to `damping` at s = 0::

        d^2 = damping^2 (1 - (s / threshold)^2)

    (Nakamura and Hanafusa 1986, with the damping of Chiaverini, Siciliano, Egeland 1994 applied
    per direction: regular directions are followed exactly.)

    Parameters
    ----------
    threshold : float
        Singular value [m/rad] below which a direction is damped.
    damping : float
        Largest damping [m/rad]. Up to `threshold / sqrt(2)` the inverse is at most `1 / (sqrt(2)
        damping)`, for larger values at most `1 / threshold`.

    Raises
    ------
    ValueError
        If a value is not positive.
    """

    class InvertedJacobian(NamedTuple):
        """Damped inverse (n, m), null space projector (n, n), least singular value of a matrix."""

        inverse: Array
        null_space: Array
        least: float

    def __init__(self, threshold: float = 0.03, damping: float = 0.02) -> None:
        self._threshold = positive('threshold', threshold)
        self._damping = positive('damping', damping)

    def of(self, jacobian: Array) -> InvertedJacobian:
        """Return the damped inverse of a Jacobian (m, n), m <= n."""
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        scaled = np.minimum(values / self._threshold, 1.0)
        damping = self._damping**2 * (1.0 - scaled * scaled)
        gains = values / (values * values + damping)
        inverse = (right.T * gains) @ left.T
        null_space = np.eye(jacobian.shape[1]) - (right.T * (gains * values)) @ right
        return self.InvertedJacobian(inverse, null_space, float(values[-1]))


class VelocityResolution:
    """Computes joint velocities for a desired tool velocity (inverse kinematics, thesis (2.8)).

    The joint velocity gives the frame's origin the desired velocity. The remaining freedom moves
    the arm toward a home configuration. The speed of a joint toward a limit is at most
    proportional to the remaining distance (Faverjon, Tournassoud 1987). A joint at that bound is
    fixed, and the other joints move instead (Flacco, De Luca, Khatib 2012). If a joint is then
    still too fast, all joints are scaled equally, so that the tool keeps its direction.

    Parameters
    ----------
    rest : (n,) array_like
        Home configuration [rad].
    rest_gain : float
        Gain of the motion toward the home configuration [1/s].
    limit_gain : float
        Largest speed of a joint toward a limit, divided by the distance to the limit [1/s].
    margin : float
        Distance [rad] to the limits that is kept.

    Attributes
    ----------
    least_singular_value : float
        Least singular value of the last Jacobian [m/rad], the distance to a singularity.
    slowdown : float
        Fraction of the desired velocity in the last result, 0 .. 1.

    Raises
    ------
    ValueError
        If a gain is negative or the home configuration does not have n joints.
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
    ) -> None:
        self.kinematics = kinematics
        self._limits = limits
        self._rest = finite('rest', rest, limits.n)
        self._inverse = inverse
        self._rest_gain = non_negative_number('rest_gain', rest_gain)
        self._limit_gain = positive('limit_gain', limit_gain)
        margin = non_negative_number('margin', margin)
        self._low = limits.position_min + margin
        self._high = limits.position_max - margin
        self.least_singular_value = np.inf
        self.slowdown = 1.0

    def resolve(self, q: Array, velocity: Array) -> Array:
        """Return joint velocities (n,) [rad/s] that move the tool with a desired velocity.

        Parameters
        ----------
        q : (n,) ndarray
            Present posture [rad].
        velocity : (3,) ndarray
            Desired velocity of the frame's origin, in base axes [m/s].
        """
        jacobian = self.kinematics.position_jacobian(q)
        preferred = self._rest_gain * (self._rest - q)
        low = self._limit_gain * (self._low - q)
        high = self._limit_gain * (self._high - q)
        dq, self.least_singular_value = resolve_within(
            self._inverse, jacobian, velocity, preferred, low, high
        )
        fastest = float((np.abs(dq) / self._limits.velocity_max).max()) + 1e-9
        self.slowdown = min(1.0, 1.0 / fastest)
        return self.slowdown * dq


def resolve_within(
    inverse: DampedInverse, jacobian: Array, task: Array, preferred: Array, low: Array, high: Array
) -> tuple[Array, float]:
    """Return joint rates (n,) within bounds for a task, and the least singular value.

    A joint beyond a bound is fixed there, and the other joints move instead. The joint that
    exceeds its bound most comes first (Flacco, De Luca, Khatib 2012). Applies to velocities and
    accelerations.

    Parameters
    ----------
    inverse : DampedInverse
    jacobian : (m, n) ndarray
    task : (m,) ndarray
        Desired rate of the task.
    preferred : (n,) ndarray
        Joint rates in the null space of the task.
    low, high : (n,) ndarray
    """
    result = inverse.of(jacobian)
    least = result.least
    rates: Array = result.inverse @ task + result.null_space @ preferred
    excess = np.maximum(rates - high, low - rates)
    if excess.max() <= 0.0:
        return rates, least
    free = jacobian.copy()
    fixed = np.zeros_like(preferred)
    is_free = np.ones(len(preferred), dtype=bool)
    while np.any(excess > 0.0):
        worst = int(np.argmax(excess))
        fixed[worst] = min(max(rates[worst], low[worst]), high[worst])
        is_free[worst] = False
        free[:, worst] = 0.0
        result = inverse.of(free)
        wanted = np.where(is_free, preferred, 0.0)
        rates = result.inverse @ (task - jacobian @ fixed) + result.null_space @ wanted
        rates = np.where(is_free, rates, fixed)
        excess = np.where(is_free, np.maximum(rates - high, low - rates), -np.inf)
    return rates, least


class CartesianMotionControl:
    """Velocity control with feedback of the tool position, thesis figure 2.7.

    The law is `dq = J#(q) (dpd + K (pd - k(q)))`, where `k(q)` is the tool position.

    Parameters
    ----------
    gain : (3,) array_like
        K [1/s]: away from singularities the tool's error decays as exp(-K t).

    Raises
    ------
    ValueError
        If a gain is negative or their number is not 3.
    """

    def __init__(self, resolution: VelocityResolution, gain: npt.ArrayLike) -> None:
        self._resolution = resolution
        self._gain = non_negative('gain', gain, 3)

    def take_over(self, q: Array) -> None:
        """Do nothing, because the law has no memory of earlier cycles."""

    def update(
        self, state: ArmState, reference: TaskReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the commanded joint velocities (n,) [rad/s]; `dt` and `base` are not used."""
        error = reference.p - self._resolution.kinematics.position(state.q)
        velocity = reference.dp + self._gain * error
        return JointCommand(dq=self._resolution.resolve(state.q, velocity))


class JointMotionControl:
    """Velocity control with feedback of the joint positions, thesis figure 2.6.

    The law is `dq = dqd + K (qd - q)`, where `qd` is the integral of
    `dqd = J#(qd) (dpd + drift_gain (pd - k(qd)))`, computed from the Cartesian path. The term with
    `drift_gain` corrects the errors of integration and damping. Measured joint angles enter only
    through K, so the reference does not depend on the measurements.

    Parameters
    ----------
    gain : (n,) array_like
        K [1/s]: the joint error decays as exp(-K t).
    drift_gain : float
        Gain that corrects the errors of integration and damping [1/s].

    Attributes
    ----------
    qd : (n,) ndarray
        Present reference of the joints [rad].

    Raises
    ------
    ValueError
        If a gain is negative or their number is not n.
    """

    def __init__(
        self, resolution: VelocityResolution, gain: npt.ArrayLike, drift_gain: float = 10.0
    ) -> None:
        n = resolution.kinematics.robot.n
        self._resolution = resolution
        self._gain = non_negative('gain', gain, n)
        self._drift_gain = positive('drift_gain', drift_gain)
        self.qd = np.zeros(n)

    def take_over(self, q: Array) -> None:
        """Start the joint reference `qd` at the present posture `q` (n,) [rad]."""
        self.qd = np.array(q)

    def update(
        self, state: ArmState, reference: TaskReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the commanded joint velocities (n,) [rad/s] for a cycle of `dt` [s]."""
        error = reference.p - self._resolution.kinematics.position(self.qd)
        dqd = self._resolution.resolve(self.qd, reference.dp + self._drift_gain * error)
        dq = dqd + self._gain * (self.qd - state.q)
        self.qd = self.qd + dt * dqd
        return JointCommand(dq=dq)
