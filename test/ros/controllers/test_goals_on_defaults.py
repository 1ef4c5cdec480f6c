"""Goals on the shipped parameters, in virtual time; `benchmarks/goals.py` has a hundred of them."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[3] / 'benchmarks'))
from goal_runs.goal_bench import GoalBench

SETTLING = 0.5  # [s]


@pytest.mark.parametrize(
    ('controller', 'seed', 'distance'),
    [
        ('computed_torque', 1, 0.3),
        ('computed_torque, boards', 0, 0.3),
        ('gravity_compensation', 1, 0.3),
    ],
)
def test_an_arm_that_differs_from_its_urdf_settles_at_its_goal(
    controller: str, seed: int, distance: float
) -> None:
    bench = GoalBench(controller, seed)
    reached = bench.go(bench.draw_goal(distance), rest=SETTLING)
    assert reached.result.state == 'succeeded', reached.result.text
    assert reached.settling < SETTLING
    # Without the observer: 11, 5 and 10 mrad.
    assert bench.rest(0.2).error < 0.0025
