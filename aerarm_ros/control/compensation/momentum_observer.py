"""Disturbance torques from the arm's generalised momentum."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
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
    gravity and the motion of the base. De Luca, Albu-Schaeffer, Haddadin, Hirzinger:
    Collision detection and safe reaction with the DLR-III (2006).

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
        self._residual = np.zeros(dynamics.n)

    @property
    def residual(self) -> Array:
        """r, (n,) [Nm]: torque on the joints beyond drive and model, positive along +q."""
        return self._residual

    def reset(self) -> None:
        """Forget everything; the next state starts anew with r = 0."""
        self._integral = None
        self._residual = np.zeros_like(self._residual)

    def update(self, state: ArmState, dt: float, base: BaseMotion | None = None) -> Array:
        """Take the state after a cycle of `dt` [s] and return r, (n,) [Nm].

        `state.tau` is the drives' torque during the cycle.
        """
        q, dq, tau = state
        fixed = self._dynamics.fixed
        p = fixed.inertia_matrix(q) @ dq
        if self._integral is None:
            self._integral = p
            return self._residual
        coriolis = fixed.coriolis_matrix(q, dq)
        bias = self._dynamics.bias(q, dq, base)
        rate = tau - bias
        rate += (coriolis + coriolis.T) @ dq
        if self._friction is not None:
            rate -= self._friction.torque(dq, bias)
        integral = self._integral + dt * rate
        # Backward Euler: stable for every gain and cycle.
        self._residual = self._gain * (p - integral) / (1.0 + dt * self._gain)
        self._integral = integral + dt * self._residual
        return self._residual
