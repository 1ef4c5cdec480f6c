"""Random moves from rest to rest, and their trajectories."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.planner.motion_plan import QUINTIC, PlanError
from aerarm_ros.planner.motion_planner import MotionPlanner

PLANNED, TRAPEZOID = 'planned', 'trapezoid'
SHAPES = (PLANNED, QUINTIC, TRAPEZOID)


@dataclass(frozen=True, eq=False)
class Move:
    """Move from rest to rest between postures (n,) [rad] in a duration [s]."""

    start: np.ndarray
    goal: np.ndarray
    duration: float

    @property
    def back(self) -> 'Move':
        """Move in the opposite direction."""
        return Move(self.goal, self.start, self.duration)

    def path(self, shape: str) -> PolynomialPath:
        """Return the path of the move as a quintic or a trapezoid."""
        make = trapezoid if shape == TRAPEZOID else PolynomialPath.rest_to_rest
        return make(self.start, self.goal, self.duration)


def trapezoid(start: np.ndarray, end: np.ndarray, duration: float) -> PolynomialPath:
    """Return a rest-to-rest path between postures (n,) with trapezoidal velocity.

    Acceleration in the first and deceleration in the last third of the time are constant.
    """
    shares = np.zeros((3, 6))  # coefficients of 1, x, x^2 in each third
    shares[:, :3] = [[0.0, 0.0, 0.25], [0.25, 0.5, 0.0], [0.75, 0.5, -0.25]]
    coefficients = shares[:, :, np.newaxis] * (end - start)
    coefficients[:, 0] += start
    return PolynomialPath(tuple(duration / 3.0 * np.arange(4.0)), coefficients)


def draw_moves(
    planner: MotionPlanner, low: np.ndarray, high: np.ndarray, seed: int, durations: list[float]
) -> Any:
    """Yield random moves, uniform over the joint ranges (n,) and between two durations [s].

    Only moves that are feasible as quintics in both directions are yielded, for comparison.
    """
    random = np.random.default_rng(seed)
    while True:
        start, goal = random.uniform(low, high, (2, len(low)))
        duration = float(random.uniform(*durations))
        quintic = planner.with_settings(objective=QUINTIC, duration=duration)
        try:
            quintic.plan(start, goal)
            quintic.plan(goal, start)
        except PlanError:
            continue
        yield Move(start, goal, duration)
