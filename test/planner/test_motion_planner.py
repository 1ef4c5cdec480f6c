"""Plans are cheaper than a quintic, within every limit by an independent check, or rejected."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.planner.motion_plan import MotionPlan, PlanError, PlanSettings
from aerarm_ros.planner.motion_planner import MotionPlanner

UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])
LOW, HIGH = np.array([-0.5, 0.4, 0.3, 0.6]), np.array([1.2, 2.2, -0.6, -0.8])
# Joints 3 and 4 have a short way, of which energy says little.
LIGHT_WAYS = [1.9, 2.34, 1.7, -1.29], [0.06, 1.62, 1.5, -1.48]
# The straight way between them is too near to the ground.
IN_THE_WAY = [1.68, -0.12, -1.74, 0.95], [-0.65, -0.02, 1.95, 1.78]


def joules(plan: MotionPlan) -> float:
    return float(plan.balance.motors.sum())


@pytest.mark.parametrize(('start', 'goal'), [(LOW, HIGH), (HIGH, UPRIGHT)])
def test_the_plan_needs_much_less_energy_than_a_quintic(start, goal, planner, dense_check) -> None:
    plan = planner.plan(start, goal)
    quintic = planner.with_settings(objective='quintic').plan(start, goal)
    assert plan.path.duration == quintic.path.duration == 2.0
    assert joules(plan) < 0.75 * joules(quintic)
    for path in (plan.path, quintic.path):
        np.testing.assert_allclose(path.evaluate(0.0).q, start, atol=1e-12)
        np.testing.assert_allclose(path.evaluate(2.0).q, goal, atol=1e-12)
    assert dense_check(plan.path).is_kept


def test_no_neighbour_of_the_plan_is_cheaper(planner, model) -> None:
    """The plan is a minimum: any small change increases its cost."""
    plan = planner.with_settings(smoothness=0.0).plan(LOW, HIGH)
    times = np.linspace(0.0, 2.0, 11)
    q, dq, ddq = plan.path.evaluate(times)
    rng = np.random.default_rng(4)
    for _ in range(10):
        bend = np.zeros_like(q)
        bend[2:-2] = 0.05 * rng.uniform(-1.0, 1.0, 4)
        dq[-1] = ddq[-1] = 0.0
        bent = PolynomialPath.quintic(times, q + bend, dq, ddq)
        assert model.balance(bent).motors.sum() > joules(plan)


def test_light_joints_do_not_move_at_very_low_speed(planner) -> None:
    """Below 0.02 rad/s, dry friction holds a joint away from its reference."""

    def creeping(**settings) -> np.ndarray:
        plan = planner.with_settings(duration=3.6, **settings).plan(*LIGHT_WAYS)
        q, dq, _ = plan.path.evaluate(np.linspace(0.0, 3.6, 400))
        on_the_way = (np.abs(q - q[0]) > 2e-3) & (np.abs(q - q[-1]) > 2e-3)
        return 3.6 * ((np.abs(dq) < 0.02) & on_the_way)[:, 2:].mean(axis=0)

    assert np.all(creeping(smoothness=0.0) > 0.5)
    assert np.all(creeping() <= creeping(objective='quintic'))


def test_the_quickest_uses_a_limit_up_and_is_quicker_than_a_quintic(planner, dense_check) -> None:
    free = planner.with_settings(duration=0.0)
    quickest = free.with_settings(objective='time').plan(LOW, HIGH)
    quintic = free.with_settings(objective='quintic').plan(LOW, HIGH)
    assert quickest.path.duration < 0.9 * quintic.path.duration
    found = dense_check(quickest.path)
    assert found.is_kept
    assert found.use > 0.9


def test_the_dearer_a_second_the_quicker_the_motion(planner) -> None:
    plans = [
        planner.with_settings(duration=0.0, time_price=price).plan(LOW, HIGH)
        for price in (3.0, 300.0)
    ]
    slow, quick = (plan.path.duration for plan in plans)
    assert quick < 0.85 * slow
    assert joules(plans[0]) < joules(plans[1])


def test_the_planner_avoids_an_obstacle_on_the_straight_path(planner, dense_check) -> None:
    with pytest.raises(PlanError, match='clearance of'):
        planner.with_settings(objective='quintic').plan(*IN_THE_WAY)
    straight = PolynomialPath.rest_to_rest(*map(np.array, IN_THE_WAY), 2.0)
    assert dense_check(straight).clearance < -0.01
    assert dense_check(planner.plan(*IN_THE_WAY).path).is_kept


def test_friction_of_loaded_gears_counts_for_the_limit_of_torque(setup, robot) -> None:
    lossy = EnergyModel(load_arm_config(), robot, load_friction=0.25)
    quickest = MotionPlanner(lossy, setup, PlanSettings(objective='time')).plan(LOW, HIGH)
    margins = {m.limit: m for m in quickest.report.margins if m.subject == 'joint2'}
    times = np.linspace(0.0, quickest.path.duration, 500)
    q, dq, ddq = quickest.path.evaluate(times)
    rigid, _ = lossy.torques(q, dq, ddq)
    needed = np.abs(rigid + lossy.friction_torque(dq, ddq, rigid))[:, 1].max()
    assert margins['torque'].reached == pytest.approx(needed, rel=0.01)


REFUSED: dict[str, tuple[Callable[[MotionPlanner], object], str]] = {
    'a goal beyond a limit': (
        lambda p: p.plan(UPRIGHT, [0.0, 1.5, 3.5, 0.0]),
        'the goal is infeasible: position of joint3: 3.5 rad at t = 0.00 s, limit 2.967 rad',
    ),
    'a start in the ground': (
        lambda p: p.plan([0.0, -0.5, 0.0, 0.0], UPRIGHT),
        'the start is infeasible: ground clearance of',
    ),
    'too short': (
        lambda p: p.with_settings(duration=0.3).plan(LOW, HIGH),
        r'a motion of 0.3 s is infeasible: \w+.* of joint.*limit.*; the fastest motion takes '
        '0.[4-9]',
    ),
    'no numbers': (
        lambda p: p.plan(UPRIGHT, [0.0, np.nan, 0.0, 0.0]),
        'goal needs 4 finite joint angles',
    ),
}


@pytest.mark.parametrize('name', list(REFUSED))
def test_an_infeasible_goal_raises_one_line_that_names_the_limit(name, planner) -> None:
    ask, message = REFUSED[name]
    with pytest.raises(PlanError, match=message) as caught:
        ask(planner)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    'wrong', [{'objective': 'comfort'}, {'duration': -1.0}, {'effort_share': 2.0}]
)
def test_settings_that_cannot_be_are_refused(wrong) -> None:
    with pytest.raises(ConfigError, match=f'plan: {next(iter(wrong))}'):
        replace(PlanSettings(), **wrong)
