"""MAVLink connections to an autopilot over UDP or a serial port."""

import errno
import os
import select
import socket
import termios
import tty
from abc import ABC, abstractmethod
from contextlib import suppress

from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter, Message

ARM, SET_MODE, SET_INTERVAL = 400, 176, 511
"""MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE and MAV_CMD_SET_MESSAGE_INTERVAL."""
CUSTOM_MODE, ARMED = 1, 128
"""Bits of MAV_MODE_FLAG."""

AUTOPILOT = 1
"""MAVLink component id of an autopilot."""
HOST = '127.0.0.1'
# This side: ids (MAV_COMP_ID_ONBOARD_COMPUTER), and fields of its HEARTBEAT.
_SYSTEM, _COMPONENT = 245, 191
_COMPANION = {'type': 18, 'autopilot': 8, 'system_status': 4, 'mavlink_version': 3}
_CHUNK = 65536
_PORTS = 65535
_UDP, _SERIAL = 'udp', 'serial'
_FORMS = 'udp:PORT (listen), udp:HOST:PORT (send first) or serial:DEVICE:BAUD'


class Line(ABC):
    """MAVLink connection over UDP or a serial port.

    Attributes
    ----------
    damaged : int
        Number of received frames with a wrong checksum.
    """

    def __init__(self, source: socket.socket | int) -> None:
        self._source = source
        self._reader = FrameReader()

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""
        return self._reader.damaged

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return all new messages, after waiting up to `patience` [s] for the first one.

        Raises
        ------
        OSError
            If the device is gone.
        """
        found: list[Message] = []
        select.select([self._source], [], [], patience)
        while (data := self._received()) is not None:
            found += self._reader.feed(data)
        return found

    @abstractmethod
    def _received(self) -> bytes | None:
        """Return received bytes, None if there are no more."""

    @abstractmethod
    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; the frame is lost if no receiver is known."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class UdpLine(Line):
    """MAVLink connection over UDP to a given address, or to the sender of the first message.

    Parameters
    ----------
    address : tuple
        Address of the autopilot; None to use the sender of the first datagram.
    bound : socket
        Socket from `udp_socket`.

    Raises
    ------
    OSError
        If the host is unknown.
    """

    def __init__(self, address: tuple[str, int] | None, bound: socket.socket) -> None:
        super().__init__(bound)
        self._socket = bound
        self._socket.setblocking(False)
        self._peer = address and (socket.gethostbyname(address[0]), address[1])

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; the frame is lost while the receiver's address is unknown."""
        if self._peer is not None:
            with suppress(ConnectionRefusedError, BlockingIOError):
                self._socket.sendto(frame, self._peer)

    def _received(self) -> bytes | None:
        try:
            data, sender = self._socket.recvfrom(_CHUNK)
        except (BlockingIOError, ConnectionRefusedError):
            return None
        self._peer = self._peer or sender
        return data if sender == self._peer else b''

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def udp_socket(host: str, port: int) -> socket.socket:
    """Return a UDP socket that is bound to a local address; raise OSError if the port is in use."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.bind((host, port))
    except OSError:
        made.close()
        raise
    return made


class SerialLine(Line):
    """MAVLink connection over a serial device with eight data bits and no parity.

    Raises
    ------
    ValueError
        If this system does not support the baud rate.
    OSError
        If the device cannot be opened.
    """

    def __init__(self, device: str, baud: int) -> None:
        rate = getattr(termios, f'B{baud}', None)
        if rate is None:
            raise ValueError(
                f'{baud} is not a baud rate of this system: use a common one, such as '
                '57600 or 921600'
            )
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        super().__init__(self._file)
        try:
            tty.setraw(self._file)
            settings = termios.tcgetattr(self._file)
            settings[4] = settings[5] = rate
            termios.tcsetattr(self._file, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(self._file)
            raise OSError(
                f'{device} is not a serial device ({error.args[-1]}): check its name'
            ) from None

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; bytes that do not fit the device's buffer are lost."""
        with suppress(OSError):  # `messages` reports a missing device
            os.write(self._file, frame)

    def _received(self) -> bytes | None:
        try:
            data = os.read(self._file, _CHUNK)
        except BlockingIOError:
            return None
        if not data:
            raise OSError(errno.EIO, 'the serial device has disappeared')
        return data

    def close(self) -> None:
        """Close the serial device."""
        os.close(self._file)


class CompanionWriter(FrameWriter):
    """Encodes MAVLink messages of a companion computer."""

    def __init__(self) -> None:
        super().__init__(_SYSTEM, _COMPONENT)

    def heartbeat(self) -> bytes:
        """Encode a HEARTBEAT."""
        return self.pack('HEARTBEAT', **_COMPANION)

    def command(self, system: int, command: int, *parameters: float) -> bytes:
        """Encode a command (MAV_CMD) to the autopilot of a vehicle, 0 for any vehicle."""
        values = {f'param{i}': value for i, value in enumerate(parameters, 1)}
        return self.pack(
            'COMMAND_LONG', target_system=system, target_component=AUTOPILOT, command=command,
            **values,
        )  # fmt: skip


def open_line(text: str) -> Line:
    """Open the MAVLink connection that a text such as `udp:14550` specifies.

    Parameters
    ----------
    text : str
        `udp:PORT`, `udp:HOST:PORT` or `serial:DEVICE:BAUD`. UDP listens on this host alone, unless
        the text is `udp:0.0.0.0:PORT`, which listens on every network.

    Raises
    ------
    ValueError
        If the text has another form, or the line cannot be opened.
    """
    kind, _, rest = text.partition(':')
    place, colon, number = rest.rpartition(':')
    is_whole = number.isdigit() and (kind == _UDP and int(number) <= _PORTS or kind == _SERIAL)
    if not is_whole or (not place and (colon or kind == _SERIAL)):
        raise ValueError(f'connection {text!r}: give {_FORMS}')
    try:
        if kind == _SERIAL:
            return SerialLine(place, int(number))
        if place in ('', '0.0.0.0'):
            return UdpLine(None, udp_socket(place or HOST, int(number)))
        return UdpLine((place, int(number)), udp_socket('0.0.0.0', 0))
    except OSError as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise ValueError(
            f'connection {text!r} cannot be opened ({reason}): check its name, its '
            'permissions and that no other program uses it'
        ) from None
