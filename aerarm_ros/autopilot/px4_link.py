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
from typing import NamedTuple, Protocol

import numpy as np

from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter, Message
from aerarm_ros.motion.signals import Array

SIMULATOR_PORT, COMPANION_PORT, OFFBOARD_PORT = 4560, 14540, 14580
"""TCP port of the simulator, and UDP ports of companion and PX4, for PX4's instance 0."""

_HOST = '127.0.0.1'
_SYSTEM, _COMPONENT = 245, 191  # ids of this side: MAV_COMP_ID_ONBOARD_COMPUTER
COMPANION = {'type': 18, 'autopilot': 8, 'system_status': 4, 'mavlink_version': 3}
"""Fields of the MAVLink message HEARTBEAT that a companion computer sends."""

_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
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


class Simulator(Protocol):
    """Interface of a connection over which this program simulates the drone for PX4."""

    is_lost: bool

    def step(self, time_us: int, frames: Sequence[bytes], patience: float) -> Controls | None:
        """Send sensor frames, with a HIL_SENSOR as the last one; return PX4's answer."""

    def close(self) -> None:
        """Close the line."""


class Companion(Protocol):
    """Interface of the UDP connection that sends set points and commands to an autopilot."""

    def send(self, frame: bytes) -> None:
        """Send a frame."""

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return all new messages, after waiting up to `patience` [s] for the first one."""

    def close(self) -> None:
        """Close the line."""


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
            self._door.bind((_HOST, port))
            self._door.listen(1)
        except OSError as error:
            self._door.close()
            raise ValueError(port_taken('TCP', port, error)) from None

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
                    return Controls(np.array(message['controls']), bool(message['mode'] & _ARMED))

    def _lose(self) -> None:
        self.is_lost = True
        if self._line is not None:
            self._line.close()
        self._line = None


class CompanionLink:
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
        self._reader = FrameReader()
        self._answers_sender = autopilot_port is None
        self._autopilot = None if autopilot_port is None else (_HOST, autopilot_port)
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.setblocking(False)
        try:
            self._line.bind((_HOST, port))
        except OSError as error:
            self._line.close()
            raise ValueError(port_taken('UDP', port, error)) from None

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; the frame is lost if the autopilot's port is closed."""
        if self._autopilot is None:
            return
        try:
            self._line.sendto(frame, self._autopilot)
        except (ConnectionRefusedError, BlockingIOError):
            return

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return all new messages, after waiting up to `patience` [s] for the first one."""
        found: list[Message] = []
        select.select([self._line], [], [], patience)
        while True:
            try:
                data, sender = self._line.recvfrom(_CHUNK)
            except (BlockingIOError, ConnectionRefusedError):
                return found
            found += self._reader.feed(data)
            if self._answers_sender:
                self._autopilot = sender

    def close(self) -> None:
        """Close the line."""
        self._line.close()


def companion_writer() -> FrameWriter:
    """Return a `FrameWriter` with the MAVLink ids of a companion computer."""
    return FrameWriter(_SYSTEM, _COMPONENT)


def port_taken(kind: str, port: int, error: OSError) -> str:
    """Return the error message for a port that cannot be opened."""
    return (
        f"{kind} port {port} for the autopilot's program cannot be opened ({error.strerror}): stop "
        'the other flight_control, simulator or ground station, or set another '
        'autopilot_instance'
    )
