"""PX4's control cascade at points with a known result."""

import numpy as np
import pytest

from aerarm_ros.autopilot.px4 import Px4Gains, torque_unit
from aerarm_ros.autopilot.px4_loops import Px4Loops, Px4SetPoint, Px4State
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource

HOVER = 0.4
ZERO = np.zeros(3)
LEVEL = np.eye(3)
NOWHERE = np.full(3, np.nan)


def turned(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i] = rotation[j, j] = c
    rotation[i, j], rotation[j, i] = -s, s
    return rotation


def answer(
    acceleration: np.ndarray = NOWHERE, rotation: np.ndarray = LEVEL, yaw: float = 0.0
) -> tuple[float, np.ndarray]:
    loops = Px4Loops(Px4Gains(), HOVER)
    set_point = Px4SetPoint(ZERO, yaw, NOWHERE, acceleration)
    return loops.update(Px4State(ZERO, ZERO, rotation, ZERO), set_point, 0.004)


def test_at_its_place_it_gives_the_hover_thrust() -> None:
    thrust, moment = answer()
    assert thrust == pytest.approx(HOVER)
    np.testing.assert_allclose(moment, ZERO, atol=1e-12)


def test_an_acceleration_leans_the_thrust() -> None:
    thrust, moment = answer(np.array([2.0, 0.0, 0.0]))
    # Nose down for an acceleration to the north; what lifts stays.
    assert thrust == pytest.approx(HOVER * np.hypot(1.0, 2.0 / GRAVITY))
    assert moment[1] < 0.0
    np.testing.assert_allclose(moment[[0, 2]], 0.0, atol=1e-12)
    thrust, _ = answer(np.array([0.0, 0.0, -GRAVITY]))
    assert thrust == pytest.approx(2.0 * HOVER)


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_turn_is_answered_by_the_product_of_both_gains(axis: int) -> None:
    _, moment = answer(rotation=turned(axis, 0.01))
    gains = Px4Gains()
    attitude = [gains.mc_att_p, gains.mc_att_p, gains.mc_yaw_p][axis]
    rate = [gains.mc_rate_p, gains.mc_rate_p, gains.mc_yawrate_p][axis]
    expected = np.zeros(3)
    expected[axis] = -0.01 * attitude * rate
    np.testing.assert_allclose(moment, expected, atol=2e-6)


def test_without_a_heading_only_its_turning_is_damped() -> None:
    east = turned(2, np.pi / 2.0)
    _, moment = answer(np.array([2.0, 0.0, 0.0]), east, np.nan)
    # Who looks east rolls to the left for an acceleration to the north.
    assert moment[0] < 0.0
    np.testing.assert_allclose(moment[1:], 0.0, atol=1e-12)
    _, held = answer(np.array([2.0, 0.0, 0.0]), east, 0.0)
    assert held[2] < -0.1
    state = Px4State(ZERO, ZERO, east, np.array([0.0, 0.0, 0.3]))
    set_point = Px4SetPoint(ZERO, np.nan, NOWHERE, NOWHERE)
    _, damped = Px4Loops(Px4Gains(), HOVER).update(state, set_point, 0.004)
    assert damped[2] == pytest.approx(-0.3 * Px4Gains().mc_yawrate_p)


def test_the_tilt_that_is_asked_for_is_limited() -> None:
    thrust, _ = answer(np.array([100.0, 0.0, 0.0]))
    assert thrust == pytest.approx(HOVER / np.cos(Px4Gains().tilt_max))


@pytest.mark.parametrize('path', ['drone.yaml', 'drones/quadrotor.yaml'])
def test_the_unit_of_torque_is_that_of_the_levers(path: str) -> None:
    drone = load_drone_config(resource('config', *path.split('/')))
    levers = np.array([rotor.position[:2] for rotor in drone.rotors])
    most = drone.column('thrust_max')[0]
    turning = np.count_nonzero(np.abs(levers) > 1e-9, axis=0)
    expected = most * np.sqrt(turning * np.square(levers).sum(axis=0) / 2.0).min()
    roll, pitch, yaw = torque_unit(drone)
    assert roll == pitch == pytest.approx(expected, rel=1e-5)
    drag = abs(drone.rotors[0].moment_per_thrust)
    assert yaw == pytest.approx(len(levers) * most * drag, rel=1e-5)


def test_the_yaw_torque_follows_slowly() -> None:
    loops = Px4Loops(Px4Gains(mc_yawrate_i=0.0), HOVER)
    level, turned_away = (
        (Px4State(ZERO, ZERO, LEVEL, ZERO), Px4SetPoint(ZERO, yaw, NOWHERE, NOWHERE))
        for yaw in (0.0, 0.2)
    )
    loops.update(*level, 0.004)
    torques = [loops.update(*turned_away, 0.004)[1][2] for _ in range(100)]
    # 2 Hz: 63 % after 80 ms.
    assert torques[19] == pytest.approx(0.63 * torques[-1], rel=0.1)


def test_gains_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match='mc_att_p'):
        Px4Gains(mc_att_p=0.0)
    scaled = Px4Gains.scaled(1.9, 8.0, 2.0)
    assert scaled.mpc_xy_vel_p_acc == pytest.approx(3.6)
