"""The tool held in the world, in the physics engine: a drone in the wind, sensors with noise."""

import pytest
from holding_flight import HELD, POOR, HeldFlight, fly

from aerarm_ros.world.world_law import WorldGains

SECONDS = 7.0  # 4 s of them count, a period of the path
ROWS = {
    'path': (HeldFlight(path=True), 3.0),
    'poor odometry': (HeldFlight(odometry=POOR), 5.0),
    '1.5 kg': (HeldFlight(mass=1.5, gains=WorldGains(144.0, 24.0)), 4.0),
    'fully actuated': (HeldFlight(drone='drones/tilted_hexarotor.yaml'), 1.5),
    'links 10 % wrong': (HeldFlight(wrong=0.1), 3.75),
}


@pytest.mark.parametrize('name', ROWS)
def test_the_tool_is_held(name: str) -> None:
    flight, goal = ROWS[name]
    flown = fly(flight, SECONDS)
    figures = flown.figures()
    assert flown.source.stops == 0
    # A fully actuated drone is stiffer, and moves less.
    assert figures.drone > 3.0, 'the wind moves the drone, or nothing is shown'
    assert figures.tool < goal


def test_held_joints_let_the_tool_move_with_the_drone() -> None:
    assert fly(HeldFlight(law=HELD), 5.0).figures().tool > 20.0
