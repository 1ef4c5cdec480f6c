"""Postures that put the tool somewhere, the cheap ones first."""

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
_NEAR = 1e-4  # [m] of the tool from its place
_DAMPING = 1e-3  # [m/rad] below which a singular value is of no use
_LARGEST_STEP = 0.4  # [rad]
_SAME = 0.05  # [rad] between postures that count as one
_TRAVEL_PRICE = 0.5  # [J/rad^2] of a way that is not planned yet
_LOSS_CURVATURE = 20.0  # [W/rad^2] about the largest of the holding loss, for the step's size
_GLANCE = 24  # instants of a way that is judged


class ToolPostures:
    """Inverse kinematics of a tool's position that leaves joints free.

    From many seeds (Gauss-Newton steps toward the place) each posture slides along what the place
    leaves free, down the loss of holding it and the way to it.

    Parameters
    ----------
    model : EnergyModel
    kinematics : Kinematics
        Of the tool's frame.
    limits : MotionLimits
    hold_time : float
        How long the arm is to stay there [s].
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
        """Return the energy of staying at q (n,) for the hold time [J]."""
        return self._hold_time * self._loss.watts(q)

    def find(self, point: ArrayLike, start: Array, duration: float) -> list[Array]:
        """Return different postures (n,) [rad], those first that cost least with their way.

        Parameters
        ----------
        point : (3,) array_like
            Where the tool shall be, in the base frame [m].
        start : (n,) ndarray
            Where the arm is [rad].
        duration : float
            Of the way [s].

        Raises
        ------
        PlanError
            If no posture within the limits has been found.
        """
        place = np.array(point, dtype=float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise PlanError(f'tool goal needs three finite numbers [m], but has {place.tolist()}')
        low, high = self._range(start)
        random = np.random.default_rng(0)  # the same goal, the same answer
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
        """Return the position limits (n,), a turn about the start where there is none."""
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
        """Return the posture to which a seed leads, None if the tool is not there."""  # fmt: skip
        q, error = np.array(seed), np.inf
        steepness = self._hold_time * _LOSS_CURVATURE + 2.0 * _TRAVEL_PRICE
        for step in range(_STEPS):
            jacobian = self._kinematics.position_jacobian(q)
            away = place - self._kinematics.position(q)
            square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(3)
            inverse = jacobian.T @ np.linalg.inv(square)
            slope = self._hold_time * self._loss.gradient(q) + 2.0 * _TRAVEL_PRICE * (q - start)
            # Less and less, so that it comes to rest on the place.
            slide = (step / _STEPS - 1.0) / steepness * slope
            change = inverse @ away + slide - inverse @ (jacobian @ slide)
            q = q + change * min(1.0, _LARGEST_STEP / (np.abs(change).max() + 1e-12))
            q = np.minimum(np.maximum(q, low), high)
            error = float(np.linalg.norm(place - self._kinematics.position(q)))
        return q if error < _NEAR else None

    def _way(self, start: Array, q: Array, duration: float) -> float:
        """Return what the straight way takes [J], coarsely."""
        straight = PolynomialPath.rest_to_rest(start, q, duration)
        times = (np.arange(_GLANCE) + 0.5) * duration / _GLANCE
        power = self._model.drives.from_supply(self._model.power(straight, times))
        return float(power.sum() * duration / _GLANCE)
