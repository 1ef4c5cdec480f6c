"""The compliant wall of the emulation."""

import numpy as np
import pytest

from aerarm_ros.simulation.wall import Wall, WallParameters

STEP = 2.5e-4


def pressed(wall: Wall, depth: float, seconds: float = 0.01, along: float = 0.0) -> np.ndarray:
    """Return the force after a time at a depth, with a tangential motion on the way."""
    count = round(seconds / STEP)
    for k in range(count):
        force = wall.update([depth, along * (k + 1) / count, 0.0], STEP)
    return force


def test_a_spring_pushes_back_and_never_pulls() -> None:
    wall = Wall(WallParameters((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), 1e3))
    assert pressed(wall, -0.01) == pytest.approx([0.0, 0.0, 0.0])
    assert pressed(wall, 0.005) == pytest.approx([-5.0, 0.0, 0.0])
    assert wall.update([0.002, 0.0, 0.0], STEP)[0] == 0.0  # leaves faster than the damper relaxes


def test_friction_sticks_then_slips() -> None:
    wall = Wall(WallParameters((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1e3, friction=0.3))
    pressed(wall, 0.005)
    assert pressed(wall, 0.005, along=5e-4)[1] == pytest.approx(-0.5, rel=0.01)
    assert pressed(wall, 0.005, along=0.02)[1] == pytest.approx(-1.5)


@pytest.mark.parametrize(('speed', 'left'), [(0.05, 4.0), (np.inf, 0.0)])
def test_the_wall_gives_way_after_its_time(speed: float, left: float) -> None:
    wall = Wall(
        WallParameters(
            (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1e3, 0.0, yields_after=0.1, yield_speed=speed
        )
    )
    assert pressed(wall, 0.005, 0.1)[0] == pytest.approx(-5.0, rel=0.01)
    assert pressed(wall, 0.005, 0.02)[0] == pytest.approx(-left, abs=0.05)
