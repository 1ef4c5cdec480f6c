"""Low-pass filtered equation of motion, as rows that are linear in payload and friction."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import non_negative
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.motion.signals import ArmState, Array

WINDOW = 5e-3
"""Interval between momentum samples [s]; the drive torque is averaged over this interval."""
SLOW = 0.03
"""Speed of a joint [rad/s] below which the direction of its dry friction is unknown."""
_SETTLED = 6.6  # time constants after which a step response has reached 99 %
_TORQUE, _DOUBT, _MODELLED = -3, -2, -1  # columns
_NO_SPIN = np.zeros(3)
_WIDTH = 0.01  # [rad/s] width of dry friction's change of direction


class MotionRow(NamedTuple):
    """Filtered equation of motion at one time, with one row per joint.

    Attributes
    ----------
    regressor : (n, 10 + 3 n) ndarray
        Torque by the ten parameters of the payload, then by viscous, Coulomb and load-dependent
        friction of each joint.
    torque : (n,) ndarray
        Torque that drive, arm and known friction do not explain [Nm].
    doubt : (n,) ndarray
        Dry friction of unknown direction [Nm].
    modelled : (n,) ndarray
        Gravity and inertia torque of the arm's model, as magnitudes [Nm].
    """

    regressor: Array
    torque: Array
    doubt: Array
    modelled: Array


class FilteredMotion:
    """Filter of both sides of the equation of motion, with two equal first-order low-passes.

    The momentum form of `MomentumRegressor` needs no second derivative of a measurement. The
    change of momentum over a window is the mean force in it, as the drives' torque is a mean. The
    change of the base's angular rate is its mean angular acceleration. The second low-pass removes
    the velocity noise that the first one amplifies.

    Parameters
    ----------
    dynamics : MovingBaseDynamics
        Model of the arm without payload.
    viscous, coulomb, load_share : (n,) array_like
        Known viscous friction [Nms/rad], Coulomb friction [Nm] and load-dependent friction [-].
    bandwidth : float
        Bandwidth of each low-pass [1/s].

    Raises
    ------
    ValueError
        If a friction coefficient is negative, or the number of coefficients is not n.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        load_share: npt.ArrayLike,
        bandwidth: float,
    ) -> None:
        n = dynamics.n
        self.n = n
        self.viscous = non_negative('viscous friction', viscous, n)
        self.coulomb = non_negative('Coulomb friction', coulomb, n)
        self.load_share = non_negative('load-dependent friction', load_share, n)
        self._dynamics = dynamics
        self._regressor = MomentumRegressor(dynamics.robot)
        self._bandwidth = bandwidth
        self._joints = np.arange(n)
        # Columns: the regressor's, the remaining torque, the doubt, the modelled torque.
        self._instant = np.zeros((n, 13 + 3 * n))
        self.reset()

    def reset(self) -> None:
        """Reset the filters after a gap in the joint states."""
        self._first: Array | None = None
        self._filtered: Array | None = None
        self._before: Array | None = None
        self._rate = np.zeros(3)
        self._momentum = np.zeros((self.n, 11))
        self._impulse = np.zeros(self.n)
        self._elapsed = 0.0
        self._age = 0.0

    @property
    def is_settled(self) -> bool:
        """Whether the filter's transient after the last `reset` has decayed to 1 %."""
        return self._age * self._bandwidth > _SETTLED

    def update(self, state: ArmState, dt: float, base: BaseMotion) -> bool:
        """Process a joint state after a cycle of `dt` [s]; return whether a window has ended.

        `state.tau` is the drives' torque during the cycle.
        """
        self._impulse += dt * state.tau
        self._elapsed += dt
        if self._before is not None and self._elapsed < WINDOW - 1e-4:
            return False
        self._end_window(state, base)
        return True

    def row(self) -> MotionRow:
        """Return the latest rows of the equation; requires two complete windows."""
        if self._filtered is None:
            raise RuntimeError('the filter has no result before two complete windows')
        values = self._filtered
        return MotionRow(values[:, :-3].copy(), *values[:, -3:].T.copy())

    def _end_window(self, state: ArmState, base: BaseMotion) -> None:
        q, dq, _ = state
        tau = self._impulse / self._elapsed
        instant = self._evaluate(q, dq, tau, base)
        momentum = np.empty_like(self._momentum)
        momentum[:, :10], instant[:, :10] = self._regressor.evaluate(
            q, dq, base.specific_force, base.angular_velocity
        )
        fixed = self._dynamics.fixed
        momentum[:, 10] = fixed.inertia_matrix(q) @ dq
        if self._before is not None:
            mean = 0.5 * (instant + self._before)
            change = (momentum - self._momentum) / self._elapsed
            mean[:, :10] += change[:, :10]
            mean[:, _TORQUE] += tau - change[:, 10] - self._of_turning(q, dq, base)
            mean[:, _MODELLED] += np.abs(change[:, 10])
            if self._first is None or self._filtered is None:
                self._first, self._filtered = mean, mean.copy()
            else:
                share = -np.expm1(-self._bandwidth * self._elapsed)
                self._first += share * (mean - self._first)
                self._filtered += share * (self._first - self._filtered)
            self._age += self._elapsed
        self._before, self._momentum = instant.copy(), momentum
        self._rate = base.angular_velocity
        self._impulse[:] = 0.0
        self._elapsed = 0.0

    def _of_turning(self, q: Array, dq: Array, base: BaseMotion) -> Array | float:
        """Return the mean joint torques (n,) in the window for the base's angular acceleration.

        The base's angular acceleration is the change of its rate. An instantaneous derivative
        would contain noise of much higher frequencies.
        """
        if not (base.angular_velocity.any() or self._rate.any()):
            return 0.0
        spin = (base.angular_velocity - self._rate) / self._elapsed
        moved, unmoved = (
            self._dynamics.bias(q, dq, base._replace(angular_acceleration=each))
            for each in (spin, _NO_SPIN)
        )
        return np.asarray(moved - unmoved)

    def _evaluate(self, q: Array, dq: Array, tau: Array, base: BaseMotion) -> Array:
        """Return all columns at an instant, except the columns of the payload."""
        instant, joints, n = self._instant, self._joints, self.n
        coriolis = self._dynamics.fixed.coriolis_matrix(q, dq)
        turning = base._replace(angular_acceleration=_NO_SPIN)
        rigid = self._dynamics.bias(q, dq, turning) - (coriolis + coriolis.T) @ dq
        sign = np.tanh(dq / _WIDTH)
        known = self.viscous * dq + self.coulomb * sign
        load = np.abs(tau - known)
        dry = self.load_share * load
        instant[joints, 10 + joints] = dq
        instant[joints, 10 + n + joints] = sign
        instant[joints, 10 + 2 * n + joints] = sign * load
        instant[:, _TORQUE] = -rigid - known - dry * sign
        instant[:, _DOUBT] = (self.coulomb + dry) * (np.abs(dq) < SLOW)
        instant[:, _MODELLED] = np.abs(rigid)
        return instant
