"""Parameters of the node `flight_control` that select a firmware and its sensors."""

import socket
from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.autopilot import ardupilot_flight, px4_flight
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.flight.arm_load import MassProperties
from aerarm_ros.ros.flight.flight_parameters import FLIGHT_PARAMETERS, flight_control

BODY = MassProperties(4.49, np.array([0.0, 0.0, -0.05]), np.diag([0.2, 0.2, 0.1]))


@pytest.mark.parametrize('sensors', ['vision', 'gps'])
@pytest.mark.parametrize('loops', ['px4_sitl', 'ardupilot_sitl'])
def test_the_position_source_of_the_firmware_is_a_parameter(
    loops: str, sensors: str, monkeypatch
) -> None:
    values = SimpleNamespace(**{one.name: one.default for one in FLIGHT_PARAMETERS})
    assert values.autopilot_sensors == 'vision'
    values.loops, values.autopilot_sensors = loops, sensors
    for module in (px4_flight, ardupilot_flight):
        for name in ('SIMULATOR_PORT', 'COMPANION_PORT'):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(('127.0.0.1', 0))
                monkeypatch.setattr(module, name, probe.getsockname()[1])
    firmware = flight_control(values, load_drone_config(), BODY)._firmware
    firmware.close()
    assert firmware._is_gps == (sensors == 'gps')
