"""MAVLink connections to an autopilot over UDP or a serial port."""

import errno
import os
import select
import socket
import termios
import tty
from typing import Protocol

from aerarm_ros.autopilot.mavlink import FrameReader, Message

_CHUNK = 65536
_PORTS = 65535
_UDP, _SERIAL = 'udp', 'serial'
_FORMS = 'udp:PORT (listen), udp:HOST:PORT (send first) or serial:DEVICE:BAUD'


class Line(Protocol):
    """Interface of a MAVLink connection over UDP or a serial port.

    Attributes
    ----------
    damaged : int
        Number of frames with a wrong checksum.
    """

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; the frame is lost if no receiver is known."""

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return all new messages, after waiting up to `patience` [s] for the first one.

        Raises
        ------
        OSError
            If the device is gone.
        """

    def close(self) -> None:
        """Close the connection."""


class UdpLine:
    """MAVLink connection over UDP to a given address, or to the sender of the first message.

    Parameters
    ----------
    address : tuple
        Address of the autopilot; None to use the sender of the first datagram.
    bound : tuple
        Local address and port.

    Raises
    ------
    OSError
        If the port is in use or the host unknown.
    """

    def __init__(self, address: tuple[str, int] | None, bound: tuple[str, int]) -> None:
        self._reader = FrameReader()
        self._peer = address and (socket.gethostbyname(address[0]), address[1])
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(bound)
        except OSError:
            self._socket.close()
            raise

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""
        return self._reader.damaged

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; the frame is lost while the receiver's address is unknown."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(frame, self._peer)
        except (ConnectionRefusedError, BlockingIOError):
            return

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return new messages of the peer, after waiting up to `patience` [s] for the first."""
        found: list[Message] = []
        select.select([self._socket], [], [], patience)
        while True:
            try:
                data, sender = self._socket.recvfrom(_CHUNK)
            except (BlockingIOError, ConnectionRefusedError):
                return found
            if self._peer is None:
                self._peer = sender
            if sender == self._peer:
                found += self._reader.feed(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class SerialLine:
    """MAVLink connection over a serial device with eight data bits and no parity.

    Parameters
    ----------
    device : str
    baud : int

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
        self._reader = FrameReader()
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
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

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""
        return self._reader.damaged

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame; bytes that do not fit the device's buffer are lost."""
        try:
            os.write(self._file, frame)
        except OSError:
            return  # `messages` reports a missing device

    def messages(self, patience: float = 0.0) -> list[Message]:
        """Return all new messages, after waiting up to `patience` [s] for the first one.

        Raises
        ------
        OSError
            If the device is gone.
        """
        found: list[Message] = []
        select.select([self._file], [], [], patience)
        while True:
            try:
                data = os.read(self._file, _CHUNK)
            except BlockingIOError:
                return found
            if not data:
                raise OSError(errno.EIO, 'the serial device has disappeared')
            found += self._reader.feed(data)

    def close(self) -> None:
        """Close the serial device."""
        os.close(self._file)


def open_line(text: str) -> UdpLine | SerialLine:
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
            return UdpLine(None, (place or '127.0.0.1', int(number)))
        return UdpLine((place, int(number)), ('0.0.0.0', 0))
    except OSError as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise ValueError(
            f'connection {text!r} cannot be opened ({reason}): check its name, its '
            'permissions and that no other program uses it'
        ) from None
