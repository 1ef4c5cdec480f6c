"""Tries the wires to a board before anything moves."""

from collections.abc import Callable
from time import sleep

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.frames.board_messages import BoardCommand
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.command_intake import Answer
from aerarm_ros.hardware.transports.spidev_transport import SpidevTransport

_EXCHANGES = 50
_PAUSE = 1e-3  # [s] a board needs 0.7 ms to prepare its next frame
_GOOD_SHARE = 0.9
_MODES = (0, 1, 2, 3)


def self_test(
    transport: SpidevTransport,
    config: ArmConfig,
    profile: FrameProfile,
    pause: Callable[[float], None] = sleep,
) -> list[Answer]:
    """Exchange frames that leave the boards off, and judge the answers by their CRC.

    Documents and working clients disagree on the boards' SPI mode. So if a board gives no
    good answer in the configured mode, the others are tried and the message names the one
    that works; the configured mode stays set.

    Parameters
    ----------
    transport
        Open.
    config
        Boards and their modes.
    profile
        The boards' frames.
    pause
        Waits some seconds between two exchanges.

    Returns
    -------
    list of Answer
        One for each board.
    """
    codec = FrameCodec(profile)
    return [
        _test_board(transport, number, config, codec, pause) for number in range(len(config.boards))
    ]


def _test_board(
    transport: SpidevTransport,
    number: int,
    config: ArmConfig,
    codec: FrameCodec,
    pause: Callable[[float], None],
) -> Answer:
    board = config.boards[number]
    place = f'{board.name} on {board.device} at {board.clock_hz / 1e6:g} MHz'
    good = _count_good(transport, number, codec, pause)
    result = f'{place}, mode {board.mode}: {good} of {_EXCHANGES} answers had a correct check'
    if good >= _GOOD_SHARE * _EXCHANGES:
        return Answer(True, result)
    if good:
        return Answer(False, f'{result}: shorten the cable or lower clock_hz')
    if transport.problem(number):
        return Answer(False, f'{result}: {transport.problem(number)}')
    for mode in _MODES:
        transport.set_mode(number, mode)
        works = mode != board.mode and _count_good(transport, number, codec, pause) > 0
        transport.set_mode(number, board.mode)
        if works:
            return Answer(False, f'{result}, but mode {mode} works: set mode: {mode} for it')
    return Answer(False, f'{result}, and no other mode works: check its supply and the SPI wires')


def _count_good(
    transport: SpidevTransport, number: int, codec: FrameCodec, pause: Callable[[float], None]
) -> int:
    good = 0
    for index in range(_EXCHANGES):
        frame = codec.encode(BoardCommand(index=index))
        good += codec.decode(transport.exchange(number, frame)) is not None
        pause(_PAUSE)
    return good
