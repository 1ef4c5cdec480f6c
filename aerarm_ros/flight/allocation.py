"""Thrusts that make a wrench."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.model.cross_product import cross

Array = npt.NDArray[np.float64]

# What a drone needs first: lift, and the moments that keep it upright.
_FIRST = np.array([False, False, True, True, True, False])
_HALVINGS = 10
_TURN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e3])  # [Nm] more than any rotors give


class Allocation:
    """Distributes a wrench to the rotors, within their limits.

    Where they cannot give it all, the moments about the horizontal axes come first, then lift, then
    the moment about the vertical and forces sideways, which are scaled down together.

    Parameters
    ----------
    drone : DroneConfig
        A drone whose rotors cannot push sideways gets no force sideways.

    Attributes
    ----------
    matrix : (6, n) ndarray
        Wrench per thrust on the body at its frame's origin.
    """

    def __init__(self, drone: DroneConfig) -> None:
        self.matrix = matrix = drone.allocation
        rows = np.ones(6, dtype=bool)
        if not drone.is_fully_actuated:
            rows[:2] = False
        inverse = np.zeros((drone.n, 6))
        inverse[:, rows] = np.linalg.pinv(matrix[rows])
        self._lift = inverse[:, 2]
        self._tilt = inverse[:, 3:5]
        self._rest = inverse[:, ~_FIRST]
        self._min, self._max = drone.column('thrust_min'), drone.column('thrust_max')

    def thrusts(self, wrench: Array) -> Array:
        """Return the thrusts (n,) [N] for a wrench (6,) on the body at its frame's origin."""
        first = self._first(wrench[2] * self._lift, self._tilt @ wrench[3:5])
        rest = self._rest @ wrench[~_FIRST]
        low, high = self._min - first, self._max - first
        with np.errstate(divide='ignore', invalid='ignore'):
            shares = np.where(rest > 0.0, high / rest, np.where(rest < 0.0, low / rest, 1.0))
        share = min(1.0, max(0.0, float(shares.min())))
        thrusts: Array = np.clip(first + share * rest, self._min, self._max)
        return thrusts

    def turning_moment(self, body: MassProperties) -> float:
        """Return the largest moment about the vertical that a body that hovers gets [Nm]."""
        weight = body.mass * GRAVITY
        force = np.array([0.0, 0.0, weight])
        hover = np.concatenate([force, cross(body.centre, force)])
        most = [abs(self.matrix[5] @ self.thrusts(hover + turn)) for turn in (-_TURN, _TURN)]
        return float(min(most))

    def _first(self, lift: Array, tilt: Array) -> Array:
        """Return lift and tilting moment, as much as can be given of them."""
        if (scale := self._scale(lift, tilt)) is not None:
            return scale * lift + tilt
        thrusts: Array = np.clip(lift, self._min, self._max)
        share, step = 0.0, 0.5
        for _ in range(_HALVINGS):
            if (scale := self._scale(lift, (share + step) * tilt)) is not None:
                share += step
                thrusts = scale * lift + share * tilt
            step *= 0.5
        return thrusts

    def _scale(self, lift: Array, tilt: Array) -> float | None:
        """Return the factor nearest to 1 on the lift that leaves room for the moment."""
        used = np.abs(lift) > 1e-9
        if np.any(tilt[~used] > self._max[~used]) or np.any(tilt[~used] < self._min[~used]):
            return None
        ends = np.array([self._min - tilt, self._max - tilt])[:, used] / lift[used]
        low, high = float(ends.min(axis=0).max()), float(ends.max(axis=0).min())
        return None if low > high else min(max(1.0, low), high)
