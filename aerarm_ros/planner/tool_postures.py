"""Postures that place the tool at a point, sorted by cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.energy.energy_model import EnergyModel, HoldingLoss
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array
from aerarm_ros.planner.motion_plan import PlanError

_SEEDS = 24
_STEPS = 30
_NEAR = 1e-4  # [m] tolerated distance of the tool from its target
_DAMPING = 1e-3  # [m/rad] below which a singular value is ignored
_LARGEST_STEP = 0.4  # [rad]
_SAME = 0.05  # [rad] largest difference of two postures that count as equal
_TRAVEL_PRICE = 0.5  # [J/rad^2] assumed price of a path that is not planned yet
# [W/rad^2] approximate largest curvature of the holding loss, for the step size
_LOSS_CURVATURE = 20.0
_GLANCE = 24  # number of instants at which a path is evaluated


class ToolPostures:
    """Inverse kinematics of a tool position with redundant joints.

    From many random postures, Gauss-Newton steps move the tool to the target. Each resulting
    posture is then improved by motions that keep the tool at the target and reduce holding loss
    and path cost.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the tool frame.
    limits : MotionLimits
        Limits of the joints.
    hold_time : float
        Time that the arm will stay at the target [s].
    """

    def __init__(
        self, model: EnergyModel, kinematics: Kinematics, limits: MotionLimits, hold_time: float
    ) -> None:
        self._model = model
        self._kinematics = kinematics
        self._limits = limits
        self._loss = HoldingLoss(model)
        self._hold_time = hold_time

    def holding(self, q: Array) -> float:
        """Return the energy [J] for holding the posture q (n,) during the hold time."""
        return self._hold_time * self._loss.watts(q)

    def find(self, point: ArrayLike, start: Array, duration: float) -> list[Array]:
        """Return different postures (n,) [rad], sorted by cost including the path.

        Parameters
        ----------
        point : (3,) array_like
            Target of the tool in the base frame [m].
        start : (n,) ndarray
            Present posture [rad].
        duration : float
            Duration of the path [s].

        Raises
        ------
        PlanError
            If no posture within the limits was found.
        """
        place = np.array(point, dtype=float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise PlanError(f'tool goal needs three finite numbers [m], but has {place.tolist()}')
        low, high = self._range(start)
        random = np.random.default_rng(0)  # fixed seed, so that equal goals give equal results
        seeds = [start, *random.uniform(low, high, (_SEEDS, len(start)))]
        found: list[Array] = []
        for seed in seeds:
            q = self._settled(place, seed, start, low, high)
            if q is not None and all(np.abs(q - other).max() > _SAME for other in found):
                found.append(q)
        if not found:
            raise PlanError(
                f'tool goal ({place[0]:.3f}, {place[1]:.3f}, {place[2]:.3f}) m is out of reach: '
                'choose a position that the tool reaches within the position limits'
            )
        return sorted(found, key=lambda q: self.holding(q) + self._way(start, q, duration))

    def _range(self, start: Array) -> tuple[Array, Array]:
        """Return the position limits (n,); one turn about the start for unlimited joints."""
        low, high = self._limits.position_min, self._limits.position_max
        return (
            np.where(np.isfinite(low), low, start - np.pi),
            np.where(np.isfinite(high), high, start + np.pi),
        )

    def _settled(
        self,
        place: Array,
        seed: Array,
        start: Array,
        low: Array,
        high: Array,
    ) -> Array | None:
        """Return the posture found from a seed posture, None if the tool misses its target."""
        q, error = np.array(seed), np.inf
        steepness = self._hold_time * _LOSS_CURVATURE + 2.0 * _TRAVEL_PRICE
        for step in range(_STEPS):
            jacobian = self._kinematics.position_jacobian(q)
            away = place - self._kinematics.position(q)
            square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(3)
            inverse = jacobian.T @ np.linalg.inv(square)
            slope = self._hold_time * self._loss.gradient(q) + 2.0 * _TRAVEL_PRICE * (q - start)
            # Decreasing steps, so that the tool converges to the target.
            slide = (step / _STEPS - 1.0) / steepness * slope
            change = inverse @ away + slide - inverse @ (jacobian @ slide)
            q = q + change * min(1.0, _LARGEST_STEP / (np.abs(change).max() + 1e-12))
            q = np.minimum(np.maximum(q, low), high)
            error = float(np.linalg.norm(place - self._kinematics.position(q)))
        return q if error < _NEAR else None

    def _way(self, start: Array, q: Array, duration: float) -> float:
        """Return an estimate of the cost of the straight path from start to q [J]."""
        straight = PolynomialPath.rest_to_rest(start, q, duration)
        times = (np.arange(_GLANCE) + 0.5) * duration / _GLANCE
        power = self._model.drives.from_supply(self._model.power(straight, times))
        return float(power.sum() * duration / _GLANCE)
