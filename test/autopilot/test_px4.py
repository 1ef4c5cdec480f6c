"""PX4's conventions (axes, units of force and torque) and parameters for a drone."""

from dataclasses import replace

import numpy as np
import pytest
from firmware_recording import BODY, DRONE, GAINS
from flying.firmware_program import ardupilot_parameters, px4_parameters

from aerarm_ros.autopilot.px4 import (
    Px4Gains,
    force_unit,
    frd_rotation,
    heading,
    hover_share,
    ned,
    torque_unit,
)
from aerarm_ros.control.base.base_motion import (
    attitude_ned_frd_to_enu_flu,
    quaternion,
    rotation_matrix,
)
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import MassProperties

QUADROTOR, TILTED = (
    load_drone_config(resource('config', 'drones', f'{name}.yaml'))
    for name in ('quadrotor', 'tilted_hexarotor')
)


def test_axes_are_north_east_down() -> None:
    np.testing.assert_array_equal(ned([1.0, 2.0, 3.0]), [2.0, 1.0, -3.0])
    turn = np.array([0.1, -0.4, 0.3, 0.85])
    in_ned = rotation_matrix(turn / np.linalg.norm(turn))
    in_enu = rotation_matrix(attitude_ned_frd_to_enu_flu(quaternion(in_ned)))
    np.testing.assert_allclose(frd_rotation(in_ned), in_enu, atol=1e-12)
    np.testing.assert_allclose(frd_rotation(in_enu), in_ned, atol=1e-12)
    for yaw, expected in ((0.0, 90.0), (90.0, 0.0), (45.0, 45.0)):  # from north to the right
        assert np.degrees(heading(np.radians(yaw))) == pytest.approx(expected)


@pytest.mark.parametrize('drone', [DRONE, QUADROTOR], ids=lambda drone: drone.name)
def test_the_unit_of_torque_is_that_of_the_levers(drone) -> None:
    levers = np.array([rotor.position[:2] for rotor in drone.rotors])
    most = drone.column('thrust_max')[0]
    turning = np.count_nonzero(np.abs(levers) > 1e-9, axis=0)
    expected = most * np.sqrt(turning * np.square(levers).sum(axis=0) / 2.0).min()
    roll, pitch, yaw = torque_unit(drone)
    assert roll == pitch == pytest.approx(expected, rel=1e-5)
    drag = abs(drone.rotors[0].moment_per_thrust)
    assert yaw == pytest.approx(len(levers) * most * drag, rel=1e-5)


def test_a_normalised_thrust_of_one_is_what_its_mixer_gives() -> None:
    for drone in (DRONE, TILTED):
        lift = float(drone.allocation[2] @ drone.column('thrust_max'))
        assert force_unit(drone)[2] == pytest.approx(lift)
    assert hover_share(DRONE, BODY) == pytest.approx(BODY.mass * GRAVITY / force_unit(DRONE)[2])
    # Sideways, of the rotors that push along an axis: a unit of all of them.
    mixer = np.abs(np.linalg.pinv(TILTED.allocation * TILTED.column('thrust_max')))
    means = [column[column > 1e-7].mean() for column in mixer.T[:2]]
    np.testing.assert_allclose(force_unit(TILTED)[:2], 1.0 / np.array(means))


def test_the_parameters_are_those_of_the_drone_file() -> None:
    found = px4_parameters(GAINS, DRONE, BODY)
    rotor = DRONE.rotors[1]
    # Forward-right-down from the centre of mass; PX4's rotors that turn left have a positive KM.
    place = [found[f'CA_ROTOR1_P{axis}'] for axis in 'XYZ']
    np.testing.assert_allclose(place, (np.array(rotor.position) - BODY.centre) * [1, -1, -1])
    assert [found[f'CA_ROTOR1_A{axis}'] for axis in 'XYZ'] == [0.0, 0.0, -1.0]
    assert found['CA_ROTOR1_KM'] == -rotor.moment_per_thrust
    assert (found['CA_ROTOR_COUNT'], found['PWM_MAIN_FUNC6']) == (DRONE.n, 106)
    assert (found['EKF2_IMU_POS_X'], found['EKF2_IMU_POS_Z']) == (0.03, -0.02)
    assert (found['MC_ROLL_P'], found['MC_PITCHRATE_K'], found['MPC_XY_P']) == (6.5, 2.0, 1.5)


def test_the_position_source_of_both_firmwares_is_a_choice() -> None:
    names = 'EKF2_EV_CTRL', 'EKF2_GPS_CTRL'
    for sensors, expected in (('vision', [15, 0]), ('gps', [0, 7])):
        found = px4_parameters(GAINS, DRONE, BODY, sensors)
        assert [found[name] for name in names] == expected
        assert ('VISO_TYPE' in ardupilot_parameters(DRONE, BODY, sensors)) == (sensors == 'vision')


def test_what_px4_cannot_fly_is_named() -> None:
    with pytest.raises(ValueError, match='MPC_THR_HOVER'):
        px4_parameters(GAINS, DRONE, MassProperties(40.0, BODY.centre, BODY.inertia))
    rotors = tuple(replace(DRONE.rotors[i % 6], name=f'rotor{i}') for i in range(14))
    with pytest.raises(ValueError, match='controls 12'):
        px4_parameters(GAINS, replace(DRONE, rotors=rotors), BODY)
    with pytest.raises(ValueError, match='mc_att_p'):
        Px4Gains(mc_att_p=0.0)
