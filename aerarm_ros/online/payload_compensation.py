"""Payload compensation: a controller's model receives the estimated payload gradually."""

import numpy as np

from aerarm_ros.control.checks import positive
from aerarm_ros.motion.signals import Array
from aerarm_ros.online.information_filter import SPECK

_WORSE = 0.3  # [s] for which the unexplained torque must be larger with the payload than without
_SMALL = 0.1  # [Nm] tolerated difference


class PayloadCompensation:
    """Payload in a controller's model, adjusted gradually to the estimated payload.

    The ten inertial parameters move along a straight line to the estimate times `share`. Physical
    bodies are a convex cone, so the payload is physical at every instant. Mass and first moment
    change at limited rates, so the torque of gravity never steps.

    If a model without the payload explains the torques better for 0.3 s, the compensation is
    undone: the payload returns to zero at limited rates. The payload stays zero until a different
    estimate arrives.

    Parameters
    ----------
    share : float
        Fraction of the estimate, 0 (no compensation) to 1.
    mass_rate : float
        Largest rate of the mass [kg/s].
    centre_rate : float
        Largest rate of the centre of mass [m/s], at the estimated mass.

    Attributes
    ----------
    carried : (10,) ndarray
        Present payload of the model.
    is_undone : bool
        Whether the last estimate proved wrong.

    Raises
    ------
    ValueError
        If the share is not in 0 .. 1 or a rate is not positive.
    """

    def __init__(self, share: float, mass_rate: float, centre_rate: float) -> None:
        if not 0.0 <= share <= 1.0:
            raise ValueError(f'payload fraction = {share} must lie in 0 .. 1')
        self.share = share
        self._mass_rate = positive('mass_rate', mass_rate)
        self._centre_rate = positive('centre_rate', centre_rate)
        self.carried = np.zeros(10)
        self.is_undone = False
        self._estimate = np.zeros(10)
        self._refused: Array | None = None
        self._worse = 0.0

    def offer(self, estimate: Array) -> None:
        """Set a new estimate (10,) of the payload; a mass of 2e-6 kg or less means no payload."""
        given = estimate if estimate[0] > 2.0 * SPECK else np.zeros(10)
        if self._refused is not None:
            if abs(given[0] - self._refused[0]) < 0.5 * self._refused[0]:
                return  # still the estimate that proved wrong
            self._refused, self.is_undone = None, False
        self._estimate = given

    def update(self, dt: float) -> Array:
        """Advance by `dt` [s] and return the payload (10,) for the controller's model."""
        target = self.share * self._estimate
        way = target - self.carried
        if not way.any():
            return self.carried
        mass = max(float(target[0]), float(self.carried[0]))
        # The largest step along the line within both rates; the first moment of an added or
        # removed mass follows that mass.
        own = np.linalg.norm(way[1:4] - way[0] * _centre(target, self.carried))
        part = 1.0
        if way[0]:
            part = min(part, dt * self._mass_rate / abs(float(way[0])))
        if own > 0.0 and mass > 0.0:
            part = min(part, dt * self._centre_rate * mass / float(own))
        self.carried = target.copy() if part == 1.0 else self.carried + part * way
        return self.carried

    def judge(self, residual: Array, share: Array, dt: float) -> bool:
        """Remove a compensation that increases the model's errors; return whether it did.

        Parameters
        ----------
        residual : (n,) ndarray
            Torque that the model with the payload leaves unexplained [Nm].
        share : (n,) ndarray
            Torque of the payload in the model [Nm].
        dt : float
            Time since the last call [s].
        """
        if not self._estimate[0]:
            self._worse = 0.0
            return False  # compensation is being removed
        # A payload that the model lacks appears as a negative disturbance.
        without = np.linalg.norm(residual - share)
        is_worse = np.linalg.norm(residual) > without + _SMALL
        self._worse = self._worse + dt if is_worse else 0.0
        if self._worse < _WORSE or self._refused is not None:
            return False
        self._refused, self.is_undone = self._estimate, True
        self._estimate = np.zeros(10)
        self._worse = 0.0
        return True


def _centre(first: Array, second: Array) -> Array:
    """Return the centre of mass (3,) [m] of the heavier body, zeros if neither has mass."""
    body = first if first[0] >= second[0] else second
    return np.asarray(body[1:4] / body[0]) if body[0] > 0.0 else np.zeros(3)
