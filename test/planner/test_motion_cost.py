"""Gradients compared with differences, term by term and together."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.planner.cost_terms import (
    ClearanceTerm,
    CostTerm,
    DriveTerm,
    LimitTerm,
    MotionCost,
    SmoothnessTerm,
)
from aerarm_ros.planner.spline_basis import SplineBasis

START, END = np.array([0.3, 0.5, -0.4, 0.8]), np.array([-1.0, 2.6, 0.9, -1.2])
LOW = np.array([0.0, -0.4, 0.0, -0.5])
BASIS = SplineBasis.of(4, 16)
STEP = 1e-6


def terms(model, setup) -> dict[str, Callable[[], CostTerm]]:
    weak = setup.limits.scaled(1.0, 0.05, 0.05)
    return {
        'energy': lambda: DriveTerm(model, setup.limits.effort, 1.0, 0.0),
        'torque': lambda: DriveTerm(model, weak.effort, 0.0, 10.0),
        'limits': lambda: LimitTerm(weak, 10.0),
        'smoothness': lambda: SmoothnessTerm(np.array([0.1, 0.2, 0.5, 1.0])),
        'clearance': lambda: ClearanceTerm(setup.clearance, 10.0),
    }


@pytest.mark.parametrize('name', ['energy', 'torque', 'limits', 'smoothness', 'clearance'])
def test_gradient_of_a_term(name, model, setup) -> None:
    make = terms(model, setup)[name]
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (4, 4)) + 0.5 * (START + END)
    if name == 'clearance':
        points = 0.1 * points + LOW
    duration = 0.8
    term = make()
    cost = MotionCost(BASIS, START, END, [term], 0.3)
    value, by_points, by_log = cost.of(points, duration)
    assert value > 0.3 * duration  # it has something to say
    numeric = np.empty_like(points)
    for index in np.ndindex(points.shape):
        moved = points.copy()
        moved[index] += STEP
        above = cost.of(moved, duration)[0]
        moved[index] -= 2.0 * STEP
        numeric[index] = (above - cost.of(moved, duration)[0]) / (2.0 * STEP)
    scale = np.abs(by_points).max()
    np.testing.assert_allclose(numeric, by_points, atol=1e-4 * scale)
    faster, slower = (cost.of(points, duration * np.exp(s))[0] for s in (-STEP, STEP))
    assert (slower - faster) / (2.0 * STEP) == pytest.approx(by_log, rel=1e-4, abs=1e-4)


def test_the_energy_term_is_the_balance(model, setup) -> None:
    basis = SplineBasis.of(4, 400)
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (4, 4)) + 0.5 * (START + END)
    term = DriveTerm(model, setup.limits.effort, 1.0, 0.0)
    value, _, _ = MotionCost(basis, START, END, [term]).of(points, 1.5)
    path = basis.path(points, START, END, 1.5)
    assert value == pytest.approx(model.balance(path).motors.sum(), rel=0.02)
