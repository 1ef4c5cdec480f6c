import numpy as np
import pytest

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.allocation import Allocation

DRONES = [
    load_drone_config(),
    load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml')),
    load_drone_config(resource('config', 'drones', 'quadrotor.yaml')),
]
HOVER = 44.0  # [N]
names = pytest.mark.parametrize('drone', DRONES, ids=lambda drone: drone.name)


@names
def test_a_wrench_within_reach_is_made(drone: DroneConfig) -> None:
    wanted = np.array([2.0, -1.0, HOVER, 0.8, -0.6, 0.1])
    if not drone.is_fully_actuated:
        wanted[:2] = 0.0
    made = drone.allocation @ Allocation(drone).thrusts(wanted)
    np.testing.assert_allclose(made, wanted, atol=1e-6 * HOVER)


@names
def test_no_rotor_is_asked_for_more_than_it_gives(drone: DroneConfig) -> None:
    rng = np.random.default_rng(0)
    low, high = drone.column('thrust_min'), drone.column('thrust_max')
    for _ in range(200):
        wrench = rng.standard_normal(6) * [20.0, 20.0, 60.0, 8.0, 8.0, 3.0]
        thrusts = Allocation(drone).thrusts(wrench)
        assert np.all(thrusts >= low)
        assert np.all(thrusts <= high)


@names
def test_turning_about_the_vertical_gives_way_to_staying_up(drone: DroneConfig) -> None:
    wanted = np.array([0.0, 0.0, HOVER, 1.5, -1.0, 50.0])
    made = drone.allocation @ Allocation(drone).thrusts(wanted)
    np.testing.assert_allclose(made[2:5], wanted[2:5], atol=1e-3)
    assert 0.05 < made[5] < 50.0


@names
def test_lift_gives_way_to_the_moments_that_keep_it_upright(drone: DroneConfig) -> None:
    strongest = drone.column('thrust_max').sum()
    wanted = np.array([0.0, 0.0, strongest, 2.0, 0.0, 0.0])
    made = drone.allocation @ Allocation(drone).thrusts(wanted)
    assert made[3] == pytest.approx(2.0, abs=1e-3)
    assert 0.3 * strongest < made[2] < 0.99 * strongest
