"""The boards on the host's SPI buses, through Linux's spidev."""

from time import perf_counter
from typing import Any

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.transports.transport import TransportError


class SpidevTransport:
    """A `Transport` over `/dev/spidev*`, one device a board, on one bus or on several.

    The device file chooses bus and chip select. A frame is one transfer of 34 bytes, whose
    duration the clock bounds (34 us at 8 MHz); boards are served one after the other. A
    transfer that fails gives no bytes and is counted by the bridge as a bad frame: one error
    does not end the cycle.

    Parameters
    ----------
    config
        Device, clock and SPI mode of each board.
    """

    def __init__(self, config: ArmConfig) -> None:
        self._boards = config.boards
        self._devices: list[Any] = []
        self._durations = [0.0] * len(self._boards)
        self._problems = [''] * len(self._boards)

    def open(self) -> None:
        """Open the devices; raises TransportError that says what to check."""
        try:
            import spidev  # needs a compiler to install, so only who has a bus installs it
        except ImportError:
            raise TransportError(
                'the module spidev is missing: pip install "aerarm_ros[spi]" (needs a C compiler), '
                'or apt install python3-spidev'
            ) from None
        self.close()
        for board in self._boards:
            device = spidev.SpiDev()
            self._devices.append(device)
            try:
                device.open_path(board.device)
                device.max_speed_hz = board.clock_hz
                device.mode = board.mode
                device.bits_per_word = 8
            except OSError as error:
                self.close()
                raise TransportError(
                    f'cannot open {board.device} for {board.name}: {error.strerror or error}: is '
                    'SPI switched on (dtparam=spi=on), is the device right, is the user in group '
                    'spi?'
                ) from None

    def close(self) -> None:
        """Close the devices."""
        for device in self._devices:
            device.close()
        self._devices.clear()

    def advance(self, now: float) -> None:
        """Nothing to do: real boards keep their own time."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Send a frame and return the one that came back, b'' if the transfer failed."""
        started = perf_counter()
        try:
            answer = bytes(self._devices[board].xfer2(frame))
            self._problems[board] = ''
        except (OSError, IndexError) as error:
            answer = b''
            reason = getattr(error, 'strerror', None) or 'the transport is not open'
            device = self._boards[board].device
            self._problems[board] = f'{device} reports: {reason}: does the device still exist?'
        self._durations[board] = perf_counter() - started
        return answer

    def exchange_time(self, board: int) -> float:
        """Duration of the last exchange with a board [s]."""
        return self._durations[board]

    def problem(self, board: int) -> str:
        """Why the last exchange with a board failed, '' if it didn't."""
        return self._problems[board]

    def set_mode(self, board: int, mode: int) -> None:
        """Change a board's SPI mode, for the self-test; raises OSError if the driver refuses."""
        self._devices[board].mode = mode
