"""Random moves, and how they are made."""

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
    """From rest to rest, (n,) [rad] each, in a duration [s]."""

    start: np.ndarray
    goal: np.ndarray
    duration: float

    @property
    def back(self) -> 'Move':
        """The way back."""
        return Move(self.goal, self.start, self.duration)

    def path(self, shape: str) -> PolynomialPath:
        """Return the quintic or the trapezoid."""
        make = PolynomialPath.trapezoid if shape == TRAPEZOID else PolynomialPath.rest_to_rest
        return make(self.start, self.goal, self.duration)


def draw_moves(
    planner: MotionPlanner, low: np.ndarray, high: np.ndarray, seed: int, durations: list[float]
) -> Any:
    """Yield moves without end: even over the joints' ranges (n,) and over two durations [s].

    Only those which a quintic can make, there and back, so that it can be compared with.
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
