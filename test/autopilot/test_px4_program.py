"""PX4's parameters for a drone, and the program's start and end."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.autopilot.px4 import torque_unit
from aerarm_ros.autopilot.px4_flight import Px4Firmware
from aerarm_ros.autopilot.px4_link import CompanionLink, SimulatorLink
from aerarm_ros.autopilot.px4_set_points import Px4SetPoints
from aerarm_ros.autopilot.px4_setup import force_unit, hover_share
from aerarm_ros.description.drone_config import GRAVITY, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import MassProperties

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.px4_program import HOW, Px4Program, find_px4
from px4_recording import BODY, DRONE, SETUP, STILL, flight, fly

TILTED = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
LIMIT = 60.0  # [s] of a busy host
STARTER = """
import sys, time
from pathlib import Path
sys.path[:0] = [{tests!r}, {benchmarks!r}]
from flying.px4_program import Px4Program
from px4_recording import BODY, DRONE, SETUP
with Px4Program(Path(sys.argv[1]), Path(sys.argv[2]), DRONE, BODY, SETUP, 9) as program:
    print(program.pid, flush=True)
    time.sleep(1000)
"""


def test_where_it_is_missing_one_line_says_how_to_get_it(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv('PX4', raising=False)
    assert find_px4() is None
    monkeypatch.setenv('PX4', str(tmp_path))
    assert find_px4() is None
    build = tmp_path / 'build' / 'px4_sitl_default'
    (build / 'bin').mkdir(parents=True)
    (build / 'bin' / 'px4').touch()
    assert find_px4() == build  # of the sources
    monkeypatch.setenv('PX4', str(build))
    assert find_px4() == build
    assert 'PX4=<folder' in HOW
    assert '\n' not in HOW


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


def test_it_ends_with_who_started_it_also_after_kill_9(tmp_path: Path) -> None:
    build, folder = tmp_path / 'build', tmp_path / 'run'
    (build / 'bin').mkdir(parents=True)
    folder.mkdir()
    program = build / 'bin' / 'px4'
    program.write_text('#!/bin/sh\nwhile true; do sleep 0.1; done\n')
    program.chmod(0o755)
    here = Path(__file__).parent
    script = STARTER.format(tests=str(here), benchmarks=str(here.parents[1] / 'benchmarks'))
    starter = subprocess.Popen(
        [sys.executable, '-c', script, str(build), str(folder)], stdout=subprocess.PIPE
    )
    assert starter.stdout is not None
    pid = int(starter.stdout.readline())
    os.kill(pid, 0)
    starter.send_signal(signal.SIGKILL)
    starter.wait()
    deadline = time.monotonic() + LIMIT
    while _lives(pid):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _lives(pid: int) -> bool:
    """Return whether a process runs, and is not a zombie."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


@pytest.mark.skipif(find_px4() is None, reason=HOW)
@pytest.mark.parametrize('sensors', ['vision', 'gps'])
def test_the_firmware_is_led_into_the_air(sensors: str, tmp_path: Path) -> None:
    setup = replace(SETUP, sensors=sensors)
    build = find_px4()
    assert build is not None
    with Px4Program(build, tmp_path, DRONE, BODY, setup, 8) as program:
        simulator, companion = SimulatorLink(4568), CompanionLink(14548, 14588)
        control = flight(simulator, companion, setup)
        fly(control)
        assert control.problem == ''
        log = program.log.read_text()
        simulator.close()
        companion.close()
    assert 'Takeoff detected' in log
    assert 'invalid' not in log


@pytest.mark.skipif(find_px4() is None, reason=HOW)
def test_a_link_that_is_lost_for_a_second_is_borne_and_then_the_failsafe_acts(
    tmp_path: Path,
) -> None:
    build = find_px4()
    assert build is not None
    with Px4Program(build, tmp_path, DRONE, BODY, SETUP, 8) as program:
        simulator, companion = SimulatorLink(4568), CompanionLink(14548, 14588)
        firmware = Px4Firmware(simulator, companion, SETUP)
        control = FirmwareFlight(DRONE, BODY, firmware, Px4SetPoints(DRONE))
        fly(control)
        for _ in range(225):  # 0.9 s without set points
            firmware.step(STILL, 0.004)
        assert firmware.is_led
        for _ in range(275):
            firmware.step(STILL, 0.004)
        assert not firmware.is_led
        assert 'Failsafe activated' in program.log.read_text()
        simulator.close()
        companion.close()
