"""Replay of recorded board answers, to run the bridge's cycle without emulated boards."""

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport

_CONFIG = load_arm_config().with_encoders('absolute')


class RecordingBoards:
    """Transport that forwards to an emulated one and stores every answer."""

    def __init__(self) -> None:
        self._boards = make_emulated_transport(_CONFIG, load_robot(), 1)
        self.answers: list[bytes] = []

    def __getattr__(self, name: str) -> object:
        return getattr(self._boards, name)

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Exchange a frame with an emulated board."""
        answer = self._boards.exchange(board, frame)
        self.answers.append(answer)
        return answer


class ReplayedBoards:
    """A `Transport` that returns recorded answers in order, one per exchange.

    Parameters
    ----------
    answers
        Answers from `RecordingBoards`, for a bridge with the same commands.
    """

    def __init__(self, answers: list[bytes]) -> None:
        self._answers = iter(answers)
        self._now = 0.0

    def advance(self, now: float) -> None:
        """Store the time."""
        self._now = now

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Return the next recorded answer."""
        return next(self._answers)

    def exchange_time(self, board: int) -> float:
        """Return the duration of an exchange on the emulated bus [s]."""
        return 1e-4

    def exchanged_at(self, board: int) -> float:
        """Return the time of the exchange [s]."""
        return self._now

    def problem(self, board: int) -> str:
        """Return ''; recorded answers have no problem."""
        return ''


def replayed_cycle(drive, cycles: int) -> BridgeCycle:
    """Return a bridge whose boards replay the answers of emulated ones to the same commands.

    `drive(bridge, cycles)` commands the bridge.
    """
    recording = RecordingBoards()
    drive(BridgeCycle(_CONFIG, recording), cycles)
    return BridgeCycle(_CONFIG, ReplayedBoards(recording.answers))
