"""The tool held in the world, in the physics engine: a drone in the wind, sensors with noise."""

import pytest
from holding_flight import HELD, POOR, HeldFlight, fly

from aerarm_ros.world.world_law import WorldGains

# Flight, its duration [s] and the largest RMS error of the tool [mm]. From the third second on,
# a flight counts for most of a period of the path (4 s), and for a period of the wind (2 s).
ROWS = {
    'path, links 10 % wrong': (HeldFlight(path=True, wrong=0.1), 6.5, 3.0),
    'poor odometry': (HeldFlight(odometry=POOR), 5.2, 5.0),
    '1.5 kg': (HeldFlight(mass=1.5, gains=WorldGains(144.0, 24.0)), 5.2, 4.0),
    'fully actuated': (HeldFlight(drone='drones/tilted_hexarotor.yaml'), 5.2, 1.5),
}


@pytest.mark.parametrize('name', ROWS)
def test_the_tool_is_held(name: str) -> None:
    flight, seconds, goal = ROWS[name]
    flown = fly(flight, seconds)
    figures = flown.figures()
    assert flown.source.stops == 0
    # A fully actuated drone is stiffer, and moves less.
    assert figures.drone > 3.0, 'the wind moves the drone, or nothing is shown'
    assert figures.tool < goal


def test_held_joints_let_the_tool_move_with_the_drone() -> None:
    assert fly(HeldFlight(law=HELD), 4.0).figures().tool > 20.0
