import numpy as np
import pytest

from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.simulation.flying_plant import Rotors

DT = 2.5e-4


@pytest.fixture
def rotors() -> Rotors:
    return Rotors(load_drone_config(), DT, timeout=0.1)


def run(rotors: Rotors, seconds: float) -> np.ndarray:
    for _ in range(round(seconds / DT)):
        wrench = rotors.step()
    return wrench


def test_thrust_follows_within_limits_with_the_time_constant(rotors: Rotors) -> None:
    rotors.command([100.0, -5.0, *[10.0] * 4])
    run(rotors, 0.025)
    wanted = np.array([18.0, 0.0, *[10.0] * 4])
    np.testing.assert_allclose(rotors.thrust, wanted * (1.0 - np.exp(-1.0)), rtol=1e-9)


def test_drag_turns_the_body_against_the_propellers(rotors: Rotors) -> None:
    # Those that turn clockwise give more: the body is turned counterclockwise.
    rotors.command([6.0, 4.0] * 3)
    wrench = run(rotors, 0.09)
    given = 1.0 - np.exp(-0.09 / 0.025)
    np.testing.assert_allclose(wrench, [0, 0, 30 * given, 0, 0, 0.016 * 6 * given], atol=1e-4)


def test_they_stop_when_commands_do(rotors: Rotors) -> None:
    assert not rotors.is_commanded
    rotors.command(np.full(6, 10.0))
    run(rotors, 0.09)
    assert rotors.is_commanded
    assert rotors.time_commanded == pytest.approx(0.09)
    run(rotors, 0.3)
    assert not rotors.is_commanded
    assert rotors.time_commanded == 0.0
    assert rotors.thrust.max() < 0.01
