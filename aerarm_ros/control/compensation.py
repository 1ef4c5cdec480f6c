"""Compensation of model errors: friction, integral action and a momentum observer."""

from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import non_negative, positive
from aerarm_ros.motion.signals import ArmState, Array


class ErrorIntegral:
    """Integral control action: `Ki` times the integral of the error, limited to `+-limit`.

    The limit prevents windup at a blocked or saturated joint.

    Parameters
    ----------
    gain : (n,) array_like
        Ki, in the output's unit per [rad s].
    limit : (n,) array_like
        Largest output, in the output's unit.

    Raises
    ------
    ValueError
        If a value is negative or the lengths differ.
    """

    def __init__(self, gain: npt.ArrayLike, limit: npt.ArrayLike) -> None:
        n = np.size(gain)
        self._gain = non_negative('integral gain', gain, n)
        self._limit = non_negative('integral limit', limit, n)
        self._value = np.zeros(n)

    def reset(self) -> None:
        """Reset the integral of the error to zero."""
        self._value = np.zeros_like(self._value)

    def update(self, error: Array, dt: float) -> Array:
        """Integrate `error` (n,) [rad] over `dt` [s] and return the limited output (n,)."""
        value = self._value + (dt * self._gain) * error
        self._value = np.minimum(np.maximum(value, -self._limit), self._limit)
        return self._value


class Fade:
    """Weight from 0 to 1 that fades something in or out at a constant rate.

    Parameters
    ----------
    duration : float
        Time from 0 to 1 [s], positive.
    share : float
        Initial weight, 0 to 1.

    Attributes
    ----------
    share : float
        Present weight, 0 to 1; may be set if this causes no jump.
    """

    def __init__(self, duration: float, share: float) -> None:
        self._rate = 1.0 / duration
        self.share = share

    def update(self, dt: float, is_on: bool) -> float:
        """Return the weight after `dt` [s], moved towards 1 if `is_on`, else towards 0."""
        change = self._rate * dt
        self.share = min(1.0, self.share + change) if is_on else max(0.0, self.share - change)
        return self.share


class FrictionCompensation:
    """Joint friction of thesis (2.6), smoothed at zero velocity, plus load-dependent friction.

    A gear loses a fraction of the transmitted torque, so dry friction is `f_s + f_l |load|`.
    Load-dependent friction matters for loads that vary with the drone: at 4 % of 1.5 Nm, the first
    joint's friction changes by a quarter.

    With a reference velocity, the compensation is exact and without noise. With a measured
    velocity, it acts near rest as a negative damping `fraction * fs / width`. With a fraction
    below one the true friction is larger at every velocity, so the joint stays passive.

    Parameters
    ----------
    viscous : (n,) array_like
        Viscous friction f_v [Nms/rad].
    coulomb : (n,) array_like
        Coulomb friction f_s [Nm].
    width : float
        Velocity [rad/s] at which three quarters of the Coulomb friction are compensated.
    fraction : float
        Compensated fraction of the friction, 0 to 1.
    load_share : float or (n,) array_like
        Load-dependent friction f_l: dry friction per transmitted torque [-].

    Raises
    ------
    ValueError
        If a coefficient is negative, the width is not positive, or the fraction is not in 0 .. 1.
    """

    def __init__(
        self,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        width: float = 0.02,
        fraction: float = 1.0,
        load_share: npt.ArrayLike = 0.0,
    ) -> None:
        n = np.size(viscous)
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f'friction fraction = {fraction} must lie in 0 .. 1')
        self._viscous = fraction * non_negative('viscous friction', viscous, n)
        self._coulomb = fraction * non_negative('Coulomb friction', coulomb, n)
        share = fraction * non_negative('load-dependent friction', load_share, n)
        self._load_share = share if np.any(share) else None
        self._steepness = 1.0 / positive('width', width)

    def torque(self, dq: Array, load: Array | None = None, measured: Array | None = None) -> Array:
        """Return the torques (n,) [Nm] that overcome the friction at velocity `dq` (n,) [rad/s].

        Parameters
        ----------
        dq : (n,) ndarray
        load : (n,) ndarray, optional
            Torque [Nm] that the gears transmit to the links; none by default.
        measured : (n,) ndarray, optional
            Measured velocity [rad/s] where `dq` is the reference; only friction that falls with
            speed depends on it.
        """
        dry: Any = self._coulomb
        if load is not None and self._load_share is not None:
            dry = dry + self._load_share * np.abs(load)
        torque: Array = self._viscous * dq + dry * np.tanh(self._steepness * dq)
        return torque

    def slopes(self, dq: Array, load: Array) -> tuple[Array, Array]:
        """Return the derivatives of the friction by velocity [Nms/rad] and by load torque [-].

        Parameters
        ----------
        dq, load : (..., n) ndarray
            As in `torque`.
        """
        sign = np.tanh(self._steepness * dq)
        share: Any = 0.0 if self._load_share is None else self._load_share
        dry = self._coulomb + share * np.abs(load)
        by_velocity: Array = self._viscous + dry * self._steepness * (1.0 - sign**2)
        by_load: Array = share * np.sign(load) * sign
        return by_velocity, by_load


class MomentumObserver:
    """Estimates, with a first-order lag, the joint torques r that the model does not explain.

    With the momentum `p = B(q) dq`, of which `dp/dt = tau + C^T dq - h + C dq + tau_ext`::

        r = K (p - p(0) - integral of (tau - tau_f + C^T dq - (h - C dq) + r) dt)

    so that `dr/dt = K (tau_ext - r)` without joint accelerations or an inverse of B. Contact,
    payload and model errors appear in r with the time constant 1/K. `h` contains gravity and the
    motion of the base. On a base that responds, B is the effective joint inertia. The momentum p
    is then the sum of `B d(dq)` over the cycles, which needs no rate of B. Disturbances of the
    base appear in r as far as they act on the joints. De Luca, Albu-Schaeffer, Haddadin,
    Hirzinger: Collision detection and safe reaction with the DLR-III (2006).

    Parameters
    ----------
    gain : (n,) array_like
        Gain K of the observer [1/s].
    friction : FrictionCompensation, optional
        Model of the friction tau_f, by measured velocity; without it r contains friction.

    Raises
    ------
    ValueError
        If a gain is negative or their number is not n.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        gain: npt.ArrayLike,
        friction: FrictionCompensation | None = None,
    ) -> None:
        self._dynamics = dynamics
        self._gain = non_negative('observer gain', gain, dynamics.n)
        self._friction = friction
        self._integral: Array | None = None
        self._last_momentum = np.zeros(dynamics.n)
        self._last_dq: Array | None = None
        self._summed = np.zeros(dynamics.n)
        self._residual = np.zeros(dynamics.n)

    @property
    def residual(self) -> Array:
        """Unexplained joint torques r (n,) [Nm], positive in the direction of +q."""
        return self._residual

    def reset(self) -> None:
        """Reset the observer; the estimate starts with r = 0 at the next state."""
        self._integral = self._last_dq = None
        self._summed = np.zeros_like(self._summed)
        self._residual = np.zeros_like(self._residual)

    def rebase(self, q: Array, dq: Array, base: BaseMotion | None = None) -> None:
        """Restart the observer at a state, but keep r; call after lost states or a new payload.

        The momentum of a payload that is declared in motion exists at once and is no torque.
        """
        if self._integral is not None:
            momentum, _ = self._momentum(q, dq, base)
            self._integral = self._integral + momentum - self._last_momentum
            self._last_momentum = momentum

    def update(self, state: ArmState, dt: float, base: BaseMotion | None = None) -> Array:
        """Process the state at the end of a cycle of `dt` [s] and return r (n,) [Nm].

        `state.tau` is the drives' torque during the cycle.
        """
        q, dq, tau = state
        p, inertia_rate = self._momentum(q, dq, base)
        self._last_momentum = p
        if self._integral is None:
            self._integral = p
            return self._residual
        bias = self._dynamics.bias(q, dq, base)
        rate = tau - bias + inertia_rate
        if self._friction is not None:
            rate -= self._friction.torque(dq, bias)
        integral = self._integral + dt * rate
        # Backward Euler: stable for every gain and cycle.
        self._residual = self._gain * (p - integral) / (1.0 + dt * self._gain)
        self._integral = integral + dt * self._residual
        return self._residual

    def _momentum(
        self, q: Array, dq: Array, base: BaseMotion | None
    ) -> tuple[Array, Array | float]:
        """Return the joint momentum p = B dq, and the part dB/dt dq of dp/dt."""
        if isinstance(base, FreeBaseMotion):
            if self._last_dq is not None:
                change = self._dynamics.inertia_matrix(q, base) @ (dq - self._last_dq)
                self._summed = self._summed + change
            self._last_dq = np.array(dq)
            return self._summed, 0.0
        fixed = self._dynamics.fixed
        coriolis = fixed.coriolis_matrix(q, dq)
        return fixed.inertia_matrix(q) @ dq, (coriolis + coriolis.T) @ dq
