"""Boards whose answers were recorded before: a bridge's cycle without the emulation's cost."""

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport

_CONFIG = load_arm_config().with_encoders('absolute')


class RecordingBoards:
    """Passes an emulated transport through, and keeps every answer."""

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
    """A `Transport` that gives recorded answers, one an exchange, in order.

    Parameters
    ----------
    answers
        Of `RecordingBoards`, from a bridge that was asked for the same.
    """

    def __init__(self, answers: list[bytes]) -> None:
        self._answers = iter(answers)
        self._now = 0.0

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def advance(self, now: float) -> None:
        """Note the time."""
        self._now = now

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Return the next answer."""
        return next(self._answers)

    def exchange_time(self, board: int) -> float:
        """Return what the emulated bus claims [s]."""
        return 1e-4

    def exchanged_at(self, board: int) -> float:
        """Return when the exchange was [s]."""
        return self._now

    def problem(self, board: int) -> str:
        """Nothing is wrong."""
        return ''


def replayed_cycle(drive, cycles: int) -> BridgeCycle:
    """Return a bridge on boards that answer as emulated ones did to the same commands.

    `drive(bridge, cycles)` is what is asked of it.
    """
    recording = RecordingBoards()
    drive(BridgeCycle(_CONFIG, recording), cycles)
    return BridgeCycle(_CONFIG, ReplayedBoards(recording.answers))
