"""Disturbance torques from the arm's generalised momentum."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_motion import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks.gains import non_negative
from aerarm_ros.control.compensation.friction_compensation import FrictionCompensation
from aerarm_ros.motion.arm_state import ArmState

Array = npt.NDArray[np.float64]


class MomentumObserver:
    """First-order estimate r of the torques the model does not explain.

    With the momentum `p = B(q) dq`, of which `dp/dt = tau + C^T dq - h + C dq + tau_ext`::

        r = K (p - p(0) - integral of (tau - tau_f + C^T dq - (h - C dq) + r) dt)

    so that `dr/dt = K (tau_ext - r)` without joint accelerations or an inverse of B: contact,
    payload and errors of the model appear in r with the time constant 1/K. `h` holds
    gravity and the motion of the base. On a base that answers, B is the inertia that the joints
    feel there and p the sum of `B d(dq)` over the cycles, which needs no rate of B; what disturbs
    the base appears in r too, as far as the joints feel it. De Luca, Albu-Schaeffer, Haddadin,
    Hirzinger: Collision detection and safe reaction with the DLR-III (2006).

    Parameters
    ----------
    dynamics : MovingBaseDynamics
    gain : (n,) array_like
        K [1/s]
    friction : FrictionCompensation, optional
        Model of the friction tau_f, by measured velocity; without it r contains friction.

    Raises
    ------
    ValueError
        If a gain is negative or their number isn't n.
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
        self._last_dq: Array | None = None
        self._summed = np.zeros(dynamics.n)
        self._residual = np.zeros(dynamics.n)

    @property
    def residual(self) -> Array:
        """r, (n,) [Nm]: torque on the joints beyond drive and model, positive along +q."""
        return self._residual

    def reset(self) -> None:
        """Forget everything; the next state starts anew with r = 0."""
        self._integral = self._last_dq = None
        self._summed = np.zeros_like(self._summed)
        self._residual = np.zeros_like(self._residual)

    def update(self, state: ArmState, dt: float, base: BaseMotion | None = None) -> Array:
        """Take the state after a cycle of `dt` [s] and return r, (n,) [Nm].

        `state.tau` is the drives' torque during the cycle.
        """
        q, dq, tau = state
        p, inertia_rate = self._momentum(q, dq, base)
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
        """Return the momentum and the part of its rate that B's own rate makes, dB/dt dq."""
        if isinstance(base, FreeBaseMotion):
            if self._last_dq is not None:
                change = self._dynamics.inertia_matrix(q, base) @ (dq - self._last_dq)
                self._summed = self._summed + change
            self._last_dq = np.array(dq)
            return self._summed, 0.0
        fixed = self._dynamics.fixed
        coriolis = fixed.coriolis_matrix(q, dq)
        return fixed.inertia_matrix(q) @ dq, (coriolis + coriolis.T) @ dq
