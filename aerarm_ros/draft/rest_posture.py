"""A posture in which an arm is clear of everything and easy to hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance.clearance_checker import ClearanceChecker
from aerarm_ros.excitation.settings.excitation_config import ExcitationConfig
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.model.dynamics import Dynamics

Array = npt.NDArray[np.float64]

_POSTURES = 400
_SHARE = 0.6  # of each joint's range, about its middle: an excitation needs room on both sides
_CLEAR_ENOUGH = 0.5  # of the widest clearance found
_NARROW = 0.01  # [m]


class RestPosture:
    """Looks for the posture that an excitation moves about.

    Of postures drawn about the middle of the joints' ranges, those count that are at least half as
    clear of everything as the clearest; of these, the one whose motors have least to hold.

    Parameters
    ----------
    robot
        The arm, its joints limited.
    effort_max
        (n,) [Nm]
    limits
        (n,) and (n,) positions [rad].
    surroundings
        Ground and clearances that are wished for.
    package_directories
        Where `package://` meshes are looked for, besides the folders above the URDF.

    Attributes
    ----------
    posture
        (n,) [rad], to a tenth, within the limits.
    surroundings
        Those wished for, clearances of 0.01 m if the arm is built closer, or no ground if even
        these cannot be kept.
    problem
        Why clearances had to be cut or could not be looked at, or that no posture is clear; else
        ''.
    """

    def __init__(
        self,
        robot: Robot,
        effort_max: Array,
        limits: tuple[Array, Array],
        surroundings: ExcitationConfig,
        package_directories: Sequence[Path] = (),
    ) -> None:
        self.problem = ''
        low, high = np.maximum(limits[0], -math.pi), np.minimum(limits[1], math.pi)
        self._limits = low, high
        self._dynamics = Dynamics(robot, np.zeros(robot.n))
        self._effort_max = effort_max
        self.surroundings = surroundings
        self._checker: ClearanceChecker | None = None
        for narrower in _narrower(surroundings):
            try:
                self._checker = _checker(robot, narrower, package_directories)
                self.surroundings = narrower
                break
            except ExcitationError as error:
                self.problem = self.problem or str(error)
        self.posture = self._search()

    def _search(self) -> Array:
        low, high = self._limits
        middle, half = 0.5 * (low + high), 0.5 * _SHARE * (high - low)
        drawn = np.random.default_rng(0).uniform(-half, half, (_POSTURES, len(low)))
        postures = [self._rounded(q) for q in (middle, *(middle + drawn))]
        margins = np.array([self._margin(q) for q in postures])
        best = float(margins.max())
        if best < 0.0:
            self.problem = (
                f'none of {len(postures)} postures keeps its clearance, the best one misses it by '
                f'{-best:.2g} m: check the collision shapes, and ground_height'
            )
        clear = [
            q for q, margin in zip(postures, margins, strict=True) if margin >= self._enough(best)
        ]
        found = min(clear, key=self._load)
        # What changes neither is left in the middle, as a base that turns about the vertical.
        for joint in range(len(found)):
            other = found.copy()
            other[joint] = self._rounded(middle)[joint]
            if self._margin(other) >= self._enough(best) and (
                self._load(other) <= self._load(found) + 1e-6
            ):
                found = other
        return found

    def _margin(self, q: Array) -> float:
        return 0.0 if self._checker is None else self._checker.margin(q)

    @staticmethod
    def _enough(best: float) -> float:
        return _CLEAR_ENOUGH * best if best > 0.0 else best

    def _load(self, q: Array) -> float:
        """Return the largest share of a joint's torque that gravity takes."""
        return float(np.max(np.abs(self._dynamics.gravity(q)) / self._effort_max))

    def _rounded(self, q: Array) -> Array:
        rounded: Array = np.clip(np.round(q, 1) + 0.0, *self._limits)
        return rounded


def _narrower(surroundings: ExcitationConfig) -> tuple[ExcitationConfig, ...]:
    """Return surroundings that ask for less and less."""
    near_ground = replace(surroundings, ground_clearance=_NARROW)
    near = replace(near_ground, self_clearance=_NARROW)
    return surroundings, near_ground, near, replace(near, ground_height=None)


def _checker(
    robot: Robot, surroundings: ExcitationConfig, package_directories: Sequence[Path]
) -> ClearanceChecker:
    return ClearanceChecker(
        robot,
        surroundings.self_clearance,
        surroundings.ground_clearance,
        surroundings.ground_height,
        package_directories,
    )
