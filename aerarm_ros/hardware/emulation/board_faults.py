"""What can be made to go wrong with an emulated board."""

from dataclasses import dataclass

from aerarm_ros.hardware.frames.frame_profile import FRAME_BYTES


@dataclass(slots=True)
class BoardFaults:
    """Lasting faults of one emulated board; all off by default.

    Attributes
    ----------
    bit_error_rate
        Share of frames, each way, in which one to three bits flip.
    lost_frame_rate
        Share of exchanges that the board misses: it reads nothing, and the line stays low.
    lost_command_rate
        Share of commands that do not reach the board, while its answers reach the host.
    dead
        No supply: the line stays low and the motors are free.
    deaf
        The board sends but receives nothing, so its time-out strikes.
    mute
        The board receives but is not heard: the line to the host stays low.
    answer_bytes
        Bytes of an answer that reach the host.
    exchange_time
        Duration of an exchange [s].
    """

    bit_error_rate: float = 0.0
    lost_frame_rate: float = 0.0
    lost_command_rate: float = 0.0
    dead: bool = False
    deaf: bool = False
    mute: bool = False
    answer_bytes: int = FRAME_BYTES
    exchange_time: float = 40e-6
