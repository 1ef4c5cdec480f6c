"""What Betaflight's simulator target says and hears over UDP, byte by byte.

The layouts are those of `src/platform/SIMULATOR/target/SITL/target.h` of Betaflight 4.6, little
endian, as a C compiler for 64 bits lays them out.
"""

import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MOTOR_PORT, STATE_PORT, RC_PORT = 9001, 9003, 9004
"""UDP: motors out (9002 has the first four alone), state in, sticks in."""

CHANNELS, MOTORS = 16, 16
LOW, MIDDLE, HIGH = 1000, 1500, 2000
"""Pulse lengths of a stick or a motor [us]."""

_STATE = struct.Struct('<d 3d 3d 4d 3d 3d d')
_RC = struct.Struct(f'<d {CHANNELS}H')
_MOTORS = struct.Struct(f'<H 2x {MOTORS}f')
_PRESSURE = 101325.0  # [Pa]; nothing that is used here depends on it


def state_packet(time: float, rate: Array, force: Array, rotation_wxyz: Array) -> bytes:
    """Return the packet of a state.

    The firmware turns y and z of the angular velocity over, and the whole of the acceleration, and
    works with forward-left-up axes; but the attitude it takes in forward-right-down ones.

    Parameters
    ----------
    time : float
        [s]
    rate, force : (3,) ndarray
        Angular velocity [rad/s] and specific force [m/s^2] in forward-left-up axes.
    rotation_wxyz : (4,) ndarray
        Attitude (w, x, y, z), body to world.
    """
    x, y, z = rate.tolist()
    nowhere = [0.0] * 6  # a place is for its GPS
    w, qx, qy, qz = rotation_wxyz.tolist()
    attitude = w, qx, -qy, -qz
    return _STATE.pack(time, x, -y, -z, *(-force).tolist(), *attitude, *nowhere, _PRESSURE)


def rc_packet(time: float, channels: Sequence[int]) -> bytes:
    """Return the packet of sticks and switches [us]: roll, pitch, throttle, yaw, then AUX1 ..."""
    filled = [*channels, *[LOW] * (CHANNELS - len(channels))]
    return _RC.pack(time, *filled)


def motor_outputs(packet: bytes) -> Array | None:
    """Return the motors' pulse lengths (n,) [us] of a packet, None if it is none."""
    if len(packet) != _MOTORS.size:
        return None
    count, *outputs = _MOTORS.unpack(packet)
    if not 0 < count <= MOTORS:
        return None
    pulses = np.array(outputs[:count])
    return pulses if np.all(np.isfinite(pulses)) else None
