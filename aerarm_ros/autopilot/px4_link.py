"""Connections to an autopilot firmware on this host (SITL), as companion or PX4's simulator.

In the TCP connection this package acts as PX4's simulator: it sends sensor data and receives thrust
fractions. PX4's time is the time of the sensors (`src/modules/simulation/simulator_mavlink`). In
the UDP connection this package acts as a companion computer: it sends set points and commands, and
receives states.
"""

import select
import socket
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aerarm_ros.autopilot.mavlink import FrameReader
from aerarm_ros.autopilot.mavlink_line import ARMED, HOST, UdpLine, udp_socket
from aerarm_ros.motion.signals import Array

SIMULATOR_PORT, COMPANION_PORT, OFFBOARD_PORT = 4560, 14540, 14580
"""TCP port of the simulator, and UDP ports of companion and PX4, for PX4's instance 0."""

_CHUNK = 65536


class Controls(NamedTuple):
    """Thrust fractions that PX4 commands, and whether PX4 is armed.

    Attributes
    ----------
    shares : (16,) ndarray
        Commanded fraction of each rotor's largest thrust, 0 while PX4 is disarmed.
    """

    shares: Array
    is_armed: bool


class SimulatorLink:
    """TCP server to which PX4 connects as to its external simulator.

    Parameters
    ----------
    port : int
        TCP port.

    Attributes
    ----------
    is_lost : bool
        Whether a connected PX4 has ended or closed the connection.
    damaged : int
        Number of frames with a wrong checksum.

    Raises
    ------
    ValueError
        If the port is in use.
    """

    def __init__(self, port: int = SIMULATOR_PORT) -> None:
        self.is_lost = False
        self._reader = FrameReader()
        self._line: socket.socket | None = None
        self._door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._door.bind((HOST, port))
            self._door.listen(1)
        except OSError as error:
            self._door.close()
            raise ValueError(_port_taken('TCP', port, error)) from None

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""
        return self._reader.damaged

    def step(self, time_us: int, frames: Sequence[bytes], patience: float) -> Controls | None:
        """Send sensor frames; return PX4's answer within `patience` [s], or None.

        The last frame is the HIL_SENSOR of `time_us`. PX4 stamps every message with the time of its
        last HIL_SENSOR, so the frames before it get the previous time.
        """
        line = self._connected(patience)
        if line is None:
            return None
        try:
            line.sendall(b''.join(frames))
            return self._answer(line, time_us, time.monotonic() + patience)
        except OSError:
            self._lose()
            return None

    def close(self) -> None:
        """Close the line."""
        self._door.close()
        if self._line is not None:
            self._line.close()

    def _connected(self, patience: float) -> socket.socket | None:
        if self._line is None and not self.is_lost:
            if not select.select([self._door], [], [], patience)[0]:
                return None
            self._line, _ = self._door.accept()
            self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._line

    def _answer(self, line: socket.socket, time_us: int, deadline: float) -> Controls | None:
        while True:
            left = max(deadline - time.monotonic(), 0.0)
            if not select.select([line], [], [], left)[0]:
                return None
            data = line.recv(_CHUNK)
            if not data:
                self._lose()
                return None
            for message in self._reader.feed(data):
                if message.name == 'HIL_ACTUATOR_CONTROLS' and message['time_usec'] >= time_us:
                    return Controls(np.array(message['controls']), bool(message['mode'] & ARMED))

    def _lose(self) -> None:
        self.is_lost = True
        if self._line is not None:
            self._line.close()
        self._line = None


class CompanionLink(UdpLine):
    """UDP connection of this program, as companion computer, to an autopilot on this host.

    Parameters
    ----------
    port : int
        UDP port of this program.
    autopilot_port : int or None
        UDP port of the autopilot; None to answer where its messages come from.

    Raises
    ------
    ValueError
        If the port is in use.
    """

    def __init__(
        self, port: int = COMPANION_PORT, autopilot_port: int | None = OFFBOARD_PORT
    ) -> None:
        peer = None if autopilot_port is None else (HOST, autopilot_port)
        super().__init__(peer, firmware_socket(port))


def firmware_socket(port: int) -> socket.socket:
    """Return a UDP socket on a port of this host; raise ValueError if the port is in use."""
    try:
        return udp_socket(HOST, port)
    except OSError as error:
        raise ValueError(_port_taken('UDP', port, error)) from None


def _port_taken(kind: str, port: int, error: OSError) -> str:
    """Return the error message for a port that cannot be opened."""
    return (
        f"{kind} port {port} for the autopilot's program cannot be opened ({error.strerror}): stop "
        'the other flight_control, simulator or ground station, or set another '
        'autopilot_instance'
    )
