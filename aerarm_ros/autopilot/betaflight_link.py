"""UDP to a Betaflight that runs as a program beside us."""

import select
import socket
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.autopilot.betaflight_packets import (
    MOTOR_PORT,
    RC_PORT,
    STATE_PORT,
    motor_outputs,
    rc_packet,
    state_packet,
)

Array = npt.NDArray[np.float64]

_HOST = '127.0.0.1'
_ANSWER = 0.02  # [s] that an answer is waited for, on a busy host


class Firmware(Protocol):
    """What flies by sticks."""

    def exchange(
        self, channels: Sequence[int], rate: Array, force: Array, rotation_wxyz: Array
    ) -> Array | None:
        """Tell sticks and state; return the motors' pulses (n,) [us], None if none came."""
        ...


class BetaflightLink:
    """Sends states and sticks, and hears the motors, on this host.

    All states have one stamp. The firmware else takes the pace of its clock from two of them and
    when they came, and on a busy host that may be hundreds of times too fast.

    Parameters
    ----------
    motor_port, state_port, rc_port : int
        Of UDP.

    Raises
    ------
    ValueError
        If the port of the motors is taken.
    """

    def __init__(
        self,
        motor_port: int = MOTOR_PORT,
        state_port: int = STATE_PORT,
        rc_port: int = RC_PORT,
    ) -> None:
        self._state_port, self._rc_port = state_port, rc_port
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._motors = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._motors.setblocking(False)
        try:
            self._motors.bind((_HOST, motor_port))
        except OSError as error:
            self.close()
            raise ValueError(
                f"loops 'betaflight': UDP port {motor_port}: {error.strerror}: does another "
                'flight_control or simulator run?'
            ) from None

    def exchange(
        self, channels: Sequence[int], rate: Array, force: Array, rotation_wxyz: Array
    ) -> Array | None:
        """Tell state and sticks; return the motors' newest pulses, see `Firmware`."""
        late = self._newest()  # the answer to the state before, on a busy host
        self._send(rc_packet(0.0, channels), self._rc_port)
        self._send(state_packet(0.0, rate, force, rotation_wxyz), self._state_port)
        select.select([self._motors], [], [], _ANSWER)
        answer = self._newest()
        return late if answer is None else answer

    def close(self) -> None:
        """Close the sockets."""
        self._sender.close()
        self._motors.close()

    def _send(self, packet: bytes, port: int) -> None:
        self._sender.sendto(packet, (_HOST, port))

    def _newest(self) -> Array | None:
        newest = None
        while True:
            try:
                packet = self._motors.recv(256)
            except (BlockingIOError, ConnectionRefusedError):
                return newest
            outputs = motor_outputs(packet)
            newest = newest if outputs is None else outputs
