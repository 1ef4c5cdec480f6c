"""Plans that spare the drone, and the term behind them."""

import numpy as np
import pytest

from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.planner.disturbance_term import DisturbanceTerm, peak_moment
from aerarm_ros.planner.motion_cost import MotionCost
from aerarm_ros.planner.spline_basis import SplineBasis

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

    careless, between, careful = (tried(disturbance_price=price) for price in (0.0, 3.0, 1000.0))
    quintic, _ = tried(objective='quintic')
    assert careful[0] < between[0] < careless[0]
    assert careless[1] < between[1] < careful[1]
    assert careful[0] < 0.5 * careless[0]
    assert careful[0] < quintic
