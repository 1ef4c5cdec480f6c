import numpy as np
import pytest
from scipy.optimize import linprog

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import MassProperties
from aerarm_ros.flight.flight_control import Allocation

DRONES = [
    load_drone_config(),
    load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml')),
    load_drone_config(resource('config', 'drones', 'quadrotor.yaml')),
]
HOVER = 44.0  # [N]
names = pytest.mark.parametrize('drone', DRONES, ids=lambda drone: drone.name)


@names
def test_wrenches_within_reach_are_made_and_thrusts_are_within_limits(drone: DroneConfig) -> None:
    allocation, wanted = Allocation(drone), np.array([2.0, -1.0, HOVER, 0.8, -0.6, 0.1])
    if not drone.is_fully_actuated:
        wanted[:2] = 0.0
    made = drone.allocation @ allocation.thrusts(wanted)
    np.testing.assert_allclose(made, wanted, atol=1e-6 * HOVER)
    low, high = drone.column('thrust_min'), drone.column('thrust_max')
    for wrench in np.random.default_rng(0).standard_normal((200, 6)) * [20, 20, 60, 8, 8, 3]:
        thrusts = allocation.thrusts(wrench)
        assert np.all((thrusts >= low) & (thrusts <= high))


@names
def test_moments_that_keep_it_upright_precede_lift_and_lift_precedes_yaw(
    drone: DroneConfig,
) -> None:
    wanted = np.array([0.0, 0.0, HOVER, 1.5, -1.0, 50.0])
    made = drone.allocation @ Allocation(drone).thrusts(wanted)
    np.testing.assert_allclose(made[2:5], wanted[2:5], atol=1e-3)
    assert 0.05 < made[5] < 50.0
    strongest = drone.column('thrust_max').sum()
    made = drone.allocation @ Allocation(drone).thrusts(np.array([0, 0, strongest, 2, 0, 0]))
    assert made[3] == pytest.approx(2.0, abs=1e-3)
    assert 0.3 * strongest < made[2] < 0.99 * strongest


@names
def test_as_much_is_given_of_the_moments_that_keep_it_upright_as_can_be(drone: DroneConfig) -> None:
    """By more or less lift, if that helps; compared with a linear program."""
    low, high = drone.column('thrust_min'), drone.column('thrust_max')
    allocation, hover = Allocation(drone), np.array([0.0, 0.0, HOVER, 0.0, 0.0, 0.0])
    tilt = np.array([0.0, 0.0, 0.0, 12.0, 30.0, 0.0])
    lift = allocation.thrusts(hover)
    ways = np.column_stack([lift, 100.0 * (allocation.thrusts(hover + 0.01 * tilt) - lift)])
    limits = np.concatenate([high, -low])
    best = linprog([0.0, -1.0], np.vstack([ways, -ways]), limits, bounds=[(0, None), (0, 1)])
    made = drone.allocation @ allocation.thrusts(hover + tilt)
    np.testing.assert_allclose(made[3:5], best.x[1] * tilt[3:5], rtol=0.01)
    assert 0.05 < best.x[1] < 0.9


@names
def test_the_largest_yaw_moment_is_reached(drone: DroneConfig) -> None:
    body = MassProperties(HOVER / GRAVITY, np.array([0.02, 0.0, -0.1]), 0.1 * np.eye(3))
    most = Allocation(drone).turning_moment(body)
    for turn, is_given in ((0.99 * most, True), (1.5 * most, False)):
        force = np.array([0.0, 0.0, HOVER])
        wanted = np.concatenate([force, np.cross(body.centre, force) + [0.0, 0.0, turn]])
        made = drone.allocation @ Allocation(drone).thrusts(wanted)
        assert (abs(made[5] - turn) < 1e-6) == is_given
