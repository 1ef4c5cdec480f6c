"""Lockstep connection to the ArduCopter firmware (SITL), from its start to the flight.

This package acts as ArduPilot's simulator over its JSON interface (`libraries/SITL/SIM_JSON.cpp`):
ArduPilot sends the pulses of its motors, waits for one line of sensor data, and advances its clock
to the line's time. So both run in lockstep.
"""

from __future__ import annotations

import json
import select
import struct
import time
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.ardupilot import motors_of
from aerarm_ros.autopilot.firmware_flight import (
    FRAME_LOCAL_FRD,
    LockstepFirmware,
    companion_line,
    firmware_socket,
    odometry_frame,
)
from aerarm_ros.autopilot.mavlink_line import SET_INTERVAL, UdpLine
from aerarm_ros.autopilot.px4 import VISION, frd_rotation, ned
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
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
_SAMPLE = 0.001  # [s] between two lines of sensor data
_HELD = 0.004  # [s] of one step while the drone is held
_TAKE_OFF = 22  # MAV_CMD_NAV_TAKEOFF
_LOCAL_POSITION = 32
_ORIGIN = {'latitude': 473977420, 'longitude': 85455940, 'altitude': 488000}
_CLIMB = 1.0  # [m] of the take-off command above the held drone


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


class ArduPilotFirmware(LockstepFirmware):
    """Connection to ArduCopter, which runs in lockstep with the simulation.

    ArduCopter can arm without receiving set points.

    Parameters
    ----------
    rotors : sequence of int
        Rotor of each motor, see `ardupilot.motors_of`.
    sensors : str
        One of `px4.SENSORS`; with GPS, ArduPilot simulates the receiver itself.
    """

    _name, _system, _second, _settling = 'ArduPilot', 1, 1.0, 3.0
    _led = 4  # the mode guided
    _near = 0.1

    def __init__(
        self, simulator: JsonLink, companion: UdpLine, rotors: Sequence[int], sensors: str = VISION
    ) -> None:
        super().__init__(companion, sensors)
        self._simulator = simulator
        self._motors = np.argsort(rotors)

    @classmethod
    def instance(cls, number: int, drone: DroneConfig, sensors: str = VISION) -> ArduPilotFirmware:
        """Return the connection to ArduPilot's instance `number`.

        Raises
        ------
        ValueError
            If ArduPilot cannot fly the drone, or a port is in use.
        """
        motors, more = motors_of(drone), PORT_STEP * number
        simulator = JsonLink(SIMULATOR_PORT + more)
        return cls(simulator, companion_line(COMPANION_PORT + more), motors, sensors)

    @property
    def is_lost(self) -> bool:
        """Whether ArduPilot has answered before and is silent now."""
        return self._simulator.is_lost

    def close(self) -> None:
        """Close the connections."""
        self._simulator.close()
        self._companion.close()

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance ArduPilot by `dt` [s]; return n thrust fractions, None without an answer.

        ArduPilot reads its gyroscopes at 1 kHz, so it gets several equal samples per step.
        """
        self._beat()
        if is_placed and not self._is_gps:
            self._companion.send(
                odometry_frame(self._writer, round(1e6 * self._time), state, FRAME_LOCAL_FRD)
            )
        count = max(round(dt / _SAMPLE), 1)
        ends = self._time + dt * np.arange(1, count + 1) / count
        answer = self._simulator.step([sensor_line(float(end), state) for end in ends])
        if answer is not None:
            self._time = float(ends[-1])
            answer = answer[self._motors]
        for message in self._companion.messages():
            self._take(message)
        return answer

    def _held_step(self, state: FlightState) -> Array | None:
        still = state._replace(velocity=np.zeros(3), rate=np.zeros(3), specific_force=None)
        return self.step(still, _HELD)

    def _has_settled(self, place: Array) -> bool:
        if self._is_due():
            self._command(SET_INTERVAL, _LOCAL_POSITION, 2e4)
            if not self._is_gps:
                self.send('SET_GPS_GLOBAL_ORIGIN', target_system=1, **_ORIGIN)
        return super()._has_settled(place)

    def _take_off(self) -> None:
        if self._place is not None and self._is_due():
            self._command(_TAKE_OFF, *[0.0] * 6, _CLIMB - float(self._place[2]))
