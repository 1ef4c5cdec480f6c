"""PX4's parameters for a drone."""

from dataclasses import replace

import numpy as np
import pytest
from px4_recording import BODY, DRONE, SETUP

from aerarm_ros.autopilot.px4 import force_unit, hover_share, torque_unit
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import MassProperties

TILTED = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))


def test_the_parameters_are_those_of_the_drone_file() -> None:
    found = SETUP.parameters(DRONE, BODY)
    assert found['CA_ROTOR_COUNT'] == DRONE.n
    rotor = DRONE.rotors[1]
    # Forward-right-down from the centre of mass; PX4's rotors that turn left have a positive KM.
    place = [found[f'CA_ROTOR1_P{axis}'] for axis in 'XYZ']
    np.testing.assert_allclose(place, (np.array(rotor.position) - BODY.centre) * [1, -1, -1])
    assert [found[f'CA_ROTOR1_A{axis}'] for axis in 'XYZ'] == [0.0, 0.0, -1.0]
    assert found['CA_ROTOR1_KM'] == -rotor.moment_per_thrust
    assert found['PWM_MAIN_FUNC6'] == 106
    assert found['MPC_THR_HOVER'] == pytest.approx(BODY.mass * GRAVITY / (6 * 18.0))
    assert (found['EKF2_IMU_POS_X'], found['EKF2_IMU_POS_Z']) == (0.03, -0.02)
    assert (found['MC_ROLL_P'], found['MC_PITCHRATE_K'], found['MPC_XY_P']) == (6.5, 2.0, 1.5)


def test_sensors_and_further_parameters_are_a_choice() -> None:
    vision = SETUP.parameters(DRONE, BODY)
    gps = replace(SETUP, sensors='gps', others={'MC_ROLL_P': 5.0}).parameters(DRONE, BODY)
    assert (vision['EKF2_EV_CTRL'], vision['EKF2_GPS_CTRL']) == (15, 0)
    assert (gps['EKF2_EV_CTRL'], gps['EKF2_GPS_CTRL'], gps['MC_ROLL_P']) == (0, 7, 5.0)


def test_a_drone_that_px4_cannot_fly_is_named() -> None:
    heavy = MassProperties(40.0, BODY.centre, BODY.inertia)
    with pytest.raises(ValueError, match='MPC_THR_HOVER'):
        SETUP.parameters(DRONE, heavy)
    many = replace(DRONE, rotors=tuple(
        replace(DRONE.rotors[i % 6], name=f'rotor{i}') for i in range(14)))  # fmt: skip
    with pytest.raises(ValueError, match='controls 12'):
        SETUP.parameters(many, BODY)


def test_a_normalised_thrust_of_one_is_what_its_mixer_gives() -> None:
    for drone in (DRONE, TILTED):
        lift = float(drone.allocation[2] @ drone.column('thrust_max'))
        assert force_unit(drone)[2] == pytest.approx(lift)
        assert torque_unit(drone)[0] > 0.0
    assert hover_share(DRONE, BODY) == pytest.approx(BODY.mass * GRAVITY / force_unit(DRONE)[2])
    # Sideways, of the rotors that push along an axis: a unit of all of them.
    sideways = force_unit(TILTED)[:2]
    mixer = np.linalg.pinv(TILTED.allocation * TILTED.column('thrust_max'))
    for axis in range(2):
        column = np.abs(mixer[:, axis])
        assert sideways[axis] == pytest.approx(1.0 / column[column > 1e-7].mean())
