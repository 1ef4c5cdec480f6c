"""PX4's conventions: axes, unit of torque and gains."""

import numpy as np
import pytest

from aerarm_ros.autopilot.px4 import Px4Gains, frd_rotation, heading, ned, torque_unit
from aerarm_ros.control.base.base_motion import (
    attitude_ned_frd_to_enu_flu,
    quaternion,
    rotation_matrix,
)
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource


def test_axes_are_north_east_down() -> None:
    np.testing.assert_array_equal(ned([1.0, 2.0, 3.0]), [2.0, 1.0, -3.0])
    turn = np.array([0.1, -0.4, 0.3, 0.85])
    in_ned = rotation_matrix(turn / np.linalg.norm(turn))
    in_enu = rotation_matrix(attitude_ned_frd_to_enu_flu(quaternion(in_ned)))
    np.testing.assert_allclose(frd_rotation(in_ned), in_enu, atol=1e-12)
    np.testing.assert_allclose(frd_rotation(in_enu), in_ned, atol=1e-12)
    for yaw, expected in ((0.0, 90.0), (90.0, 0.0), (45.0, 45.0)):  # from north to the right
        assert np.degrees(heading(np.radians(yaw))) == pytest.approx(expected)


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


def test_gains_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match='mc_att_p'):
        Px4Gains(mc_att_p=0.0)
