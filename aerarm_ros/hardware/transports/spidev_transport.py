"""The boards on the host's SPI buses, through Linux's spidev."""

import importlib.util

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.transports.spidev_device import SpidevDevice
from aerarm_ros.hardware.transports.transport import TransportError


class SpidevTransport:
    """A `Transport` over `/dev/spidev*`, one device a board, on one bus or on several.

    The device file chooses bus and chip select. A frame is one transfer of 34 bytes, whose
    duration the clock bounds (34 us at 8 MHz); boards are served one after the other. A
    transfer that fails gives no bytes and is counted by the bridge as a bad frame: one error
    does not end the cycle. A device that vanishes is opened again when it is back.

    Parameters
    ----------
    config
        Device, clock and SPI mode of each board.
    """

    def __init__(self, config: ArmConfig) -> None:
        self._devices = [SpidevDevice(board) for board in config.boards]

    def open(self) -> None:
        """Open the devices; raises TransportError that says what to check."""
        if importlib.util.find_spec('spidev') is None:
            raise TransportError(
                'the module spidev is missing: pip install "spidev>=3.5,<4" (needs a C compiler), '
                'or apt install python3-spidev'
            )
        self.close()
        try:
            for device in self._devices:
                device.open()
        except TransportError:
            self.close()
            raise

    def close(self) -> None:
        """Close the devices."""
        for device in self._devices:
            device.close()

    def advance(self, now: float) -> None:
        """Nothing to do: real boards keep their own time."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Send a frame and return the one that came back, b'' if the transfer failed."""
        return self._devices[board].transfer(frame)

    def exchange_time(self, board: int) -> float:
        """Duration of the last exchange with a board [s]."""
        return self._devices[board].duration

    def exchanged_at(self, board: int) -> float:
        """When the last exchange with a board ended [s, monotonic]."""
        return self._devices[board].ended

    def problem(self, board: int) -> str:
        """Why the last exchange with a board failed, '' if it didn't."""
        return self._devices[board].problem

    def set_mode(self, board: int, mode: int) -> None:
        """Change a board's SPI mode, for the self-test; raises OSError if the driver refuses."""
        self._devices[board].set_mode(mode)
