"""UDP connection to the ArduPilot firmware that runs as a program on this host (SITL).

This package acts as ArduPilot's simulator over its JSON interface (`libraries/SITL/SIM_JSON.cpp`):
ArduPilot sends the pulses of its motors, waits for one line of sensor data, and advances its clock
to the line's time. So both run in lockstep.
"""

import json
import select
import struct
import time
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.px4 import frd_rotation, ned
from aerarm_ros.autopilot.px4_link import firmware_socket
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

SIMULATOR_PORT, COMPANION_PORT, PORT_STEP = 9002, 14550, 10
"""UDP ports of simulator and companion for instance 0, and their increment per instance number.

The option -I of ArduPilot sets the instance number.
"""

_MOTORS = struct.Struct('<HHI16H')
_MAGIC = 18458
_LOW, _RANGE = 1000.0, 1000.0  # [us]
_CHUNK = 65536
_BOOT = 0.02  # [s] to wait for ArduPilot's first packet
_PATIENCE = 2.0  # [s] after which a silent ArduPilot counts as ended


def sensor_line(time_s: float, state: FlightState) -> bytes:
    """Return a line of sensor data for ArduPilot: IMU, attitude, position and velocity.

    Without a measured specific force the drone counts as resting.
    """
    level = GRAVITY * state.rotation[2]
    force = level if state.specific_force is None else state.specific_force
    x, y, z, w = pin.Quaternion(frd_rotation(state.rotation)).coeffs().tolist()
    values = {
        'timestamp': time_s,
        'imu': {'gyro': frd_to_flu(state.rate).tolist(), 'accel_body': frd_to_flu(force).tolist()},
        'position': ned(state.position).tolist(),
        'quaternion': [w, x, y, z],
        'velocity': ned(state.velocity).tolist(),
    }
    return f'\n{json.dumps(values)}\n'.encode()


def motor_shares(packet: bytes) -> tuple[int, Array] | None:
    """Return frame number and thrust fractions (16,) of a motor packet; None for others."""
    if len(packet) != _MOTORS.size:
        return None
    magic, _, number, *pulses = _MOTORS.unpack(packet)
    if magic != _MAGIC:
        return None
    return number, np.clip((np.array(pulses) - _LOW) / _RANGE, 0.0, 1.0)


class JsonLink:
    """UDP server that acts as ArduPilot's external simulator (`--model JSON`).

    Parameters
    ----------
    port : int
        UDP port.

    Attributes
    ----------
    is_lost : bool
        Whether ArduPilot has answered before and is silent now.

    Raises
    ------
    ValueError
        If the port is in use.
    """

    def __init__(self, port: int = SIMULATOR_PORT) -> None:
        self.is_lost = False
        self._number = -1  # of the last motor packet
        self._shares: Array | None = None
        self._autopilot: tuple[str, int] | None = None
        self._line = firmware_socket(port)

    def step(self, lines: Sequence[bytes]) -> Array | None:
        """Send lines of sensor data; return the thrust fractions (16,), None without an answer.

        ArduPilot asks first, so the first call only waits for its first packet.
        """
        for line in lines:
            if self._autopilot is None and not self._receive(_BOOT):
                return None
            assert self._autopilot is not None
            self._line.sendto(line, self._autopilot)
            if not self._receive(_PATIENCE):
                self.is_lost, self._autopilot = True, None
                return None
            self.is_lost = False
        return self._shares

    def close(self) -> None:
        """Close the socket."""
        self._line.close()

    def _receive(self, patience: float) -> bool:
        """Wait for ArduPilot's next motor packet, ignore repeated ones; return success."""
        deadline = time.monotonic() + patience
        while select.select([self._line], [], [], max(deadline - time.monotonic(), 0.0))[0]:
            packet, sender = self._line.recvfrom(_CHUNK)
            motors = motor_shares(packet)
            if motors is not None and (motors[0], sender) != (self._number, self._autopilot):
                self._number, self._shares = motors
                self._autopilot = sender
                return True
        return False
