"""UDP connection to the Betaflight firmware that runs as a process on this host (SITL).

The layouts are those of `src/platform/SIMULATOR/target/SITL/target.h` of Betaflight 4.6, little
endian, as a C compiler for 64 bits lays them out.
"""

import select
import socket
import struct
from collections.abc import Sequence

import numpy as np

from aerarm_ros.autopilot.mavlink_line import HOST
from aerarm_ros.autopilot.px4_link import firmware_socket
from aerarm_ros.motion.signals import Array

MOTOR_PORT, STATE_PORT, RC_PORT = 9001, 9003, 9004
"""UDP ports of Betaflight for motor outputs, drone state and sticks.

Port 9002 sends only the first four motor outputs.
"""

CHANNELS, MOTORS = 16, 16
LOW, MIDDLE, HIGH = 1000, 1500, 2000
"""Lowest, middle and highest pulse length [us] of a stick or motor."""

_STATE = struct.Struct('<d 3d 3d 4d 3d 3d d')
_RC = struct.Struct(f'<d {CHANNELS}H')
_MOTORS = struct.Struct(f'<H 2x {MOTORS}f')
_PRESSURE = 101325.0  # [Pa]; no used function depends on it


def state_packet(time: float, rate: Array, force: Array, rotation_wxyz: Array) -> bytes:
    """Return the UDP packet that sends Betaflight the state of the simulated drone.

    The firmware reverses y and z of the angular velocity and all axes of the acceleration, and
    uses forward-left-up axes. The firmware expects the attitude with y and z of body and world
    reversed.

    Parameters
    ----------
    time : float
        Simulation time [s].
    rate, force : (3,) ndarray
        Angular velocity [rad/s] and specific force [m/s^2] in forward-left-up axes.
    rotation_wxyz : (4,) ndarray
        Attitude (w, x, y, z), body to world.
    """
    x, y, z = rate.tolist()
    nowhere = [0.0] * 6  # position, for the firmware's GPS only
    w, qx, qy, qz = rotation_wxyz.tolist()
    attitude = w, qx, -qy, -qz
    return _STATE.pack(time, x, -y, -z, *(-force).tolist(), *attitude, *nowhere, _PRESSURE)


def rc_packet(time: float, channels: Sequence[int]) -> bytes:
    """Return the UDP packet of the channels [us] roll, pitch, throttle, yaw, AUX1 and so on."""
    filled = [*channels, *[LOW] * (CHANNELS - len(channels))]
    return _RC.pack(time, *filled)


def motor_outputs(packet: bytes) -> Array | None:
    """Return the pulse lengths (n,) [us] of a motor packet, None for other packets."""
    if len(packet) != _MOTORS.size:
        return None
    count, *outputs = _MOTORS.unpack(packet)
    if not 0 < count <= MOTORS:
        return None
    pulses = np.array(outputs[:count])
    return pulses if np.all(np.isfinite(pulses)) else None


_ANSWER = 0.02  # [s] longest wait for an answer on a busy host


class BetaflightLink:
    """UDP connection that sends states and sticks to Betaflight, and receives motor pulses.

    All state packets carry the same stamp. From different stamps and their arrival times, the
    firmware would derive the speed of its clock. On a busy host that clock could run hundreds of
    times too fast.

    Parameters
    ----------
    motor_port, state_port, rc_port : int
        UDP ports.

    Raises
    ------
    ValueError
        If the port of the motors is in use.
    """

    def __init__(
        self, motor_port: int = MOTOR_PORT, state_port: int = STATE_PORT, rc_port: int = RC_PORT
    ) -> None:
        self._state_port, self._rc_port = state_port, rc_port
        self._motors = firmware_socket(motor_port)
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._motors.setblocking(False)

    def exchange(
        self, channels: Sequence[int], rate: Array, force: Array, rotation_wxyz: Array
    ) -> Array | None:
        """Send sticks and drone state; return the latest motor pulses (n,) [us], or None."""
        late = self._newest()  # the late answer to the previous state, on a busy host
        state = state_packet(0.0, rate, force, rotation_wxyz)
        self._sender.sendto(rc_packet(0.0, channels), (HOST, self._rc_port))
        self._sender.sendto(state, (HOST, self._state_port))
        select.select([self._motors], [], [], _ANSWER)
        answer = self._newest()
        return late if answer is None else answer

    def close(self) -> None:
        """Close the sockets."""
        self._sender.close()
        self._motors.close()

    def _newest(self) -> Array | None:
        newest = None
        while True:
            try:
                packet = self._motors.recv(256)
            except (BlockingIOError, ConnectionRefusedError):
                return newest
            outputs = motor_outputs(packet)
            newest = newest if outputs is None else outputs
