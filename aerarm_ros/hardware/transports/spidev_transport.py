"""Transport to the motor boards over the SPI buses of the host, with Linux's spidev."""

import errno
import importlib.util
from collections.abc import Callable
from functools import partial
from time import monotonic, sleep
from typing import Any

from aerarm_ros.description.arm_config import ArmConfig, BoardConfig
from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.hardware.frames.board_messages import BoardCommand
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import FrameProfile

# Errors of the driver for a removed device or a file that is not open.
_GONE = frozenset({errno.ESHUTDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF})
# Number of consecutive other errors after which the device is reopened as well.
_ERRORS_MAX = 200
# [s] time between two attempts to open the device, doubled each time
_WAIT_MIN, _WAIT_MAX = 0.2, 5.0


class TransportError(OSError):
    """Error: an SPI bus cannot be opened; the message states what to check."""


class SpidevDevice:
    """SPI device of Linux (`/dev/spidev*`), which is reopened after a removal.

    A removed device, for example an unplugged adapter or a reloaded driver, leaves an open file on
    which every transfer fails. Transfers on that file also fail after the device has returned.
    Therefore the file is closed, and opening is tried again after waits that grow from 0.2 to 5
    s. A single transfer error is ignored, because the next frame follows within a millisecond.

    Parameters
    ----------
    board
        Configuration with device, clock and SPI mode.
    clock
        Function that returns the time [s, monotonic].

    Attributes
    ----------
    problem
        Reason why the last transfer failed, '' if it succeeded.
    duration, ended
        Duration of the last transfer [s], and its end time [s].
    """

    def __init__(self, board: BoardConfig, clock: Callable[[], float] = monotonic) -> None:
        self.problem = ''
        self.duration = self.ended = 0.0
        self._board = board
        self._clock = clock
        self._file: Any = None
        self._is_wanted = False
        self._reason = 'the SPI transport is not open'
        self._errors = 0
        self._wait = _WAIT_MIN
        self._next_attempt = 0.0

    def open(self) -> None:
        """Open the SPI device; if that fails, raise TransportError with advice on what to check."""
        board = self._board
        try:
            self._file = self._opened()
        except OSError as error:
            raise TransportError(
                f'{board.device} of {board.name} cannot be opened ({error.strerror or error}): '
                'switch SPI on (dtparam=spi=on), check the device name, and add the user to '
                'group spi'
            ) from None
        self._is_wanted = True

    def close(self) -> None:
        """Close the device without reopening it; all methods may still be called."""
        self._is_wanted = False
        self._reason = 'the SPI transport is not open'
        self._drop()

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame over SPI and return the received frame, b'' if the transfer failed."""
        started = self._clock()
        if self._file is None and self._is_wanted and started >= self._next_attempt:
            self._reopen(started)
        answer = self._transferred(frame) if self._file is not None else b''
        self.ended = self._clock()
        self.duration = self.ended - started
        if self._errors == 0 and self._file is not None:
            self.problem = ''
        else:
            self.problem = self._account()
        return answer

    def set_mode(self, mode: int) -> None:
        """Change the SPI mode until the device is reopened; raise OSError if that fails."""
        if self._file is None:
            raise OSError(errno.EBADF, self._account())
        self._file.mode = mode

    def _transferred(self, frame: bytes) -> bytes:
        try:
            answer = bytes(self._file.xfer2(frame))
        except OSError as error:
            self._errors += 1
            self._reason = error.strerror or str(error)
            if error.errno in _GONE or self._errors >= _ERRORS_MAX:
                self._drop()
                self._next_attempt = self._clock() + self._wait
            return b''
        self._errors = 0
        self._wait = _WAIT_MIN
        return answer

    def _reopen(self, now: float) -> None:
        self._wait = min(2.0 * self._wait, _WAIT_MAX)
        self._next_attempt = now + self._wait
        try:
            self._file = self._opened()
        except OSError:
            return  # the original reason is more informative
        self._errors = 0

    def _opened(self) -> Any:
        # imported here, because spidev needs a compiler and is installed only on hosts with SPI
        import spidev

        file = spidev.SpiDev()
        try:
            file.open_path(self._board.device)
            file.max_speed_hz = self._board.clock_hz
            file.mode = self._board.mode
            file.bits_per_word = 8
        except OSError:
            file.close()
            raise
        return file

    def _drop(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _account(self) -> str:
        text = (
            f'{self._board.device} reports an error ({self._reason}): check that the device '
            'still exists'
        )
        if self._file is None and self._is_wanted:
            text += f'. The bridge tries to open the device again every {self._wait:g} s'
        return text


class SpidevTransport:
    """`Transport` over the SPI devices `/dev/spidev*` of the boards, one device per board.

    The device file selects bus and chip select. A frame is one transfer of 34 bytes, whose duration
    the clock determines (34 us at 8 MHz); frames of several boards are exchanged one after the
    other. A failed transfer returns no bytes, which the bridge counts as a bad frame; a single
    transfer error does not stop the arm. A removed device is reopened when it returns.

    Parameters
    ----------
    config
        Configuration with device, clock and SPI mode of each board.
    """

    def __init__(self, config: ArmConfig) -> None:
        self._config = config
        self._devices = [SpidevDevice(board) for board in config.boards]

    def open(self) -> None:
        """Open all SPI devices; if that fails, raise TransportError with advice."""
        if importlib.util.find_spec('spidev') is None:
            raise TransportError(
                'the Python module spidev is missing: pip install "spidev>=3.5,<4" (needs a C '
                'compiler), or apt install python3-spidev'
            )
        self.close()
        try:
            for device in self._devices:
                device.open()
        except TransportError:
            self.close()
            raise

    def close(self) -> None:
        """Close the SPI devices."""
        for device in self._devices:
            device.close()

    def advance(self, now: float) -> None:
        """Do nothing, because real boards run on their own clock."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Send a board a frame and return the received frame, b'' if the transfer failed."""
        return self._devices[board].transfer(frame)

    def exchange_time(self, board: int) -> float:
        """Duration of the last frame exchange with a board [s]."""
        return self._devices[board].duration

    def exchanged_at(self, board: int) -> float:
        """End time of the last frame exchange with a board [s, monotonic]."""
        return self._devices[board].ended

    def problem(self, board: int) -> str:
        """Reason why the last frame exchange with a board failed; '' after a success."""
        return self._devices[board].problem

    def set_mode(self, board: int, mode: int) -> None:
        """Change a board's SPI mode for the self-test; raise OSError if the driver refuses."""
        self._devices[board].set_mode(mode)

    def self_test(self, profile: FrameProfile) -> list[Answer]:
        """Test the connection to each board; return one result per board."""
        return self_test(self, self._config, profile)


def make_transport(config: ArmConfig) -> SpidevTransport:
    """Return the transport that `transport:=spidev` selects."""
    return SpidevTransport(config)


_EXCHANGES = 50
_PAUSE = 1e-3  # [s] pause between two exchanges; a board needs 0.7 ms to prepare its next frame
_GOOD_SHARE = 0.9
_MODES = (0, 1, 2, 3)


def self_test(
    transport: SpidevTransport,
    config: ArmConfig,
    profile: FrameProfile,
    pause: Callable[[float], None] = sleep,
) -> list[Answer]:
    """Check the connection to each board with frames that leave the board's motors off.

    Documents and existing clients disagree on the boards' SPI mode. If a board gives no valid
    answer in the configured mode, the other modes are tried and the message names the working one;
    the configured mode stays set.

    Parameters
    ----------
    transport
        Open transport.
    config
        Configuration with boards and their modes.
    profile
        Frame layout of the boards.
    pause
        Function that waits a time [s] between two exchanges.

    Returns
    -------
    list of Answer
        One result per board.
    """
    answers = []
    for number, board in enumerate(config.boards):
        count_good = partial(_count_good, transport, number, profile, pause)
        good = count_good()
        result = (
            f'{board.name} on {board.device} at {board.clock_hz / 1e6:g} MHz, mode {board.mode}: '
            f'{good} of {_EXCHANGES} answers had a correct checksum'
        )
        if not good:
            result += _reason(transport, number, board, count_good)
        elif good < _GOOD_SHARE * _EXCHANGES:
            result += ': shorten the cable or lower clock_hz'
        answers.append(Answer(good >= _GOOD_SHARE * _EXCHANGES, result))
    return answers


def _reason(
    transport: SpidevTransport, number: int, board: BoardConfig, count_good: Callable[[], int]
) -> str:
    """Return why a board gives no valid answer in its configured mode."""
    if transport.problem(number):
        return f': {transport.problem(number)}'
    for mode in _MODES:
        transport.set_mode(number, mode)
        works = mode != board.mode and count_good() > 0
        transport.set_mode(number, board.mode)
        if works:
            return f', but mode {mode} works: set the key mode of this board to {mode}'
    return ', and no other mode works: check the supply of the board and the SPI wires'


def _count_good(
    transport: SpidevTransport, number: int, profile: FrameProfile, pause: Callable[[float], None]
) -> int:
    codec, good = FrameCodec(profile), 0
    for index in range(_EXCHANGES):
        frame = codec.encode(BoardCommand(index=index))
        good += codec.decode(transport.exchange(number, frame)) is not None
        pause(_PAUSE)
    return good
