"""Plans that reduce the load on the drone, and the term behind them."""

import numpy as np
import pytest

from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.planner.cost_terms import DisturbanceTerm, MotionCost, peak_moment
from aerarm_ros.planner.motion_plan import PlanError
from aerarm_ros.planner.spline_basis import SplineBasis

# The base turns by 260 degrees; and joint 2 goes from one side to the other.
TURNED, TO = np.array([-2.8, 2.63, 0.23, -0.71]), np.array([1.71, 0.75, -0.28, -1.53])
LIFTED, LEVEL = np.array([0.04, 2.76, -1.22, 1.13]), np.array([0.15, 0.1, 2.76, -0.41])
START, GOAL = np.array([0.9, 1.3, -0.4, 0.8]), np.array([-1.2, 2.0, 0.9, -0.6])


@pytest.fixture(scope='module')
def body(robot, model) -> WholeBodyDynamics:
    return WholeBodyDynamics(robot, model.dynamics.rotor_inertia)


def test_the_reaction_and_its_slopes_are_those_of_the_whole_body(body) -> None:
    rng = np.random.default_rng(6)
    rows = rng.uniform(-1.0, 1.0, (3, 4))
    wrench, *slopes = (np.array(part) for part in body.reaction_with_slopes(*rows))
    np.testing.assert_allclose(wrench, body.forces(*rows, np.zeros(3))[:6], atol=1e-12)
    for index, slope in enumerate(slopes):
        for joint in range(4):
            step = np.zeros((3, 4))
            step[index, joint] = 1e-6
            above, below = (body.forces(*(rows + s * step), np.zeros(3))[:6] for s in (1, -1))
            np.testing.assert_allclose(slope[:, joint], (above - below) / 2e-6, atol=1e-6)


def test_the_gradient_is_that_of_the_cost(body) -> None:
    basis = SplineBasis.of(4, 16)
    points = 0.5 * (START + GOAL) + np.random.default_rng(1).uniform(-0.3, 0.3, (4, 4))
    cost = MotionCost(basis, START, GOAL, [DisturbanceTerm(body, 2.0, 0.8)])
    value, by_points, by_log = cost.of(points, 1.2)
    rng = np.random.default_rng(2)
    for _ in range(5):
        way = rng.uniform(-1e-6, 1e-6, points.shape)
        change = cost.of(points + way, 1.2)[0] - cost.of(points - way, 1.2)[0]
        assert change / 2.0 == pytest.approx(float((by_points * way).sum()), rel=1e-4)
    change = cost.of(points, 1.2 * np.exp(1e-6))[0] - cost.of(points, 1.2 * np.exp(-1e-6))[0]
    assert change / 2e-6 == pytest.approx(by_log, rel=1e-4)
    assert value > 0.0


def test_the_dearer_the_disturbance_the_less_of_it_for_more_energy(planner, body) -> None:
    times = np.linspace(0.0, 2.0, 200)

    def tried(**settings) -> tuple[float, float]:
        plan = planner.with_settings(**settings).plan(START, GOAL)
        moment = peak_moment(body, plan.path.evaluate(times))
        return moment, float(plan.balance.motors.sum())

    careless, between = (tried(disturbance_price=price) for price in (0.0, 3.0))
    careful, quintic = (tried(objective=name) for name in ('disturbance', 'quintic'))
    assert careful[0] < between[0] < careless[0]
    assert careless[1] < between[1] < careful[1]
    assert careful[0] < 0.5 * careless[0]
    assert careful[0] < quintic[0]


@pytest.mark.parametrize(('start', 'goal', 'share'), [(TURNED, TO, 0.4), (LIFTED, LEVEL, 0.78)])
def test_the_least_peak_is_far_below_a_quintics(
    start, goal, share, planner, body, dense_check
) -> None:
    """Folding the arm during the motion helps a turn about the column, but hardly a lift."""
    plan, quintic = (
        planner.with_settings(objective=name).plan(start, goal).path
        for name in ('disturbance', 'quintic')
    )
    times = np.linspace(0.0, 2.0, 300)
    most = share * peak_moment(body, quintic.evaluate(times))
    assert peak_moment(body, plan.evaluate(times)) < most
    assert dense_check(plan).is_kept


def test_least_disturbance_without_a_duration_is_refused(planner) -> None:
    with pytest.raises(PlanError, match='objective disturbance needs a duration'):
        planner.with_settings(objective='disturbance', duration=0.0).plan(START, GOAL)
