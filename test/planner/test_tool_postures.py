import numpy as np
import pytest

from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.planner.motion_plan import PlanError
from aerarm_ros.planner.motion_planner import ToolPostures

START = np.array([0.5, 1.2, 0.3, -0.4])
PLACE = np.array([0.3, 0.35, 0.65])


@pytest.fixture(scope='module')
def kinematics(robot) -> Kinematics:
    return Kinematics(robot, 'tool0')


@pytest.fixture
def postures(model, kinematics, planner) -> ToolPostures:
    return ToolPostures(model, kinematics, planner.limits, hold_time=5.0)


def test_every_posture_puts_the_tool_there_within_the_limits(postures, kinematics, planner) -> None:
    found = postures.find(PLACE, START, 2.0)
    assert len(found) > 3
    for q in found:
        np.testing.assert_allclose(kinematics.position(q), PLACE, atol=1e-4)
        assert np.all(q >= planner.limits.position_min)
        assert np.all(q <= planner.limits.position_max)


def test_one_that_is_held_long_is_cheap_to_hold(model, kinematics, planner) -> None:
    """For one hour only the loss counts: no posture of a grid at the place has much less."""

    def least(hold_time: float) -> np.ndarray:
        made = ToolPostures(model, kinematics, planner.limits, hold_time)
        return made.find(PLACE, START, 2.0)[0]

    meter = ToolPostures(model, kinematics, planner.limits, 1.0)
    long, short = least(3600.0), least(0.0)
    assert meter.holding(long) < meter.holding(short)
    assert np.linalg.norm(short - START) < np.linalg.norm(long - START) + 1e-6
    null = np.linalg.svd(kinematics.position_jacobian(long))[2][-1]
    for side in (-0.1, 0.1):  # a minimum along what the place leaves free
        q = long + side * null
        for _ in range(20):
            q = q + np.linalg.pinv(kinematics.position_jacobian(q)) @ (
                PLACE - kinematics.position(q)
            )
        assert meter.holding(q) > 0.999 * meter.holding(long)


@pytest.mark.parametrize(
    ('place', 'message'),
    [
        ([2.0, 0.0, 0.5], r'tool goal \(2.000, 0.000, 0.500\) m is out of reach'),
        ([0.55, 0.0, -0.1], 'clearance of'),
        ([np.inf, 0.0, 0.0], 'three finite numbers'),
    ],
)
def test_a_place_out_of_reach_is_one_line(place, message, planner) -> None:
    with pytest.raises(PlanError, match=message):
        planner.plan_tool(START, place)
