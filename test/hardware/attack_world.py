"""Emulated boards and arm that live in true time, whatever the host does meanwhile."""

from collections.abc import Callable

from frame_log import FrameLog

from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport

_PIECE = 1e-3  # [s] in which the arm is looked at; less than what the boards catch up with at once

# Where the host may be held up in a cycle; an exchange with board 0 as an example.
WAKE = 'wake'  # before it reads its clock
READ = 'read'  # between reading its clock and the first exchange
EXCHANGE = 'exchange'  # ('exchange 0') before the frame is on the wire
ANSWER = 'answer'  # ('answer 0') after it, before the answer is looked at

Delays = Callable[[int, str], float]


class AttackWorld:
    """A `Transport` to emulated boards that notes every frame, and the host's clock.

    Time passes where the host's script, `delays(cycle, point)` in seconds, says so, and to the
    next cycle; boards and plant go on with it, and the board time-outs strike, as they do beside
    a real host.

    Parameters
    ----------
    boards
        The emulated boards on their plant.
    watch
        Called every millisecond of true time, pauses of the host included, with that time [s].

    Attributes
    ----------
    now
        True time, which is the host's clock [s, monotonic].
    frames
        Every frame of the run.
    cycle
        Number of the host's cycle, for the script.
    """

    def __init__(self, boards: EmulatedTransport, watch: Callable[[float], None]) -> None:
        self.boards = boards
        self.now = 100.0
        self.frames = FrameLog()
        self.cycle = 0
        self._watch = watch
        self._delays: Delays | None = None
        self._exchanged = [(0.0, 0.0) for _ in boards.boards]  # end and duration of the last
        boards.advance(self.now)

    def script(self, delays: Delays | None) -> None:
        """Take another script for the host."""
        self._delays = delays

    def clock(self) -> float:
        """Return the host's clock [s]."""
        return self.now

    def pass_time(self, until: float) -> None:
        """Let boards and arm live until a true time [s]."""
        while until > self.now:
            self.now = until if until - self.now < 1.001 * _PIECE else self.now + _PIECE
            self.boards.advance(self.now)
            self._watch(self.now)

    def hold_up(self, point: str) -> None:
        """Hold the host up where its script says so."""
        if self._delays is not None:
            seconds = self._delays(self.cycle, point)
            if seconds > 0.0:
                self.pass_time(self.now + seconds)

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def advance(self, now: float) -> None:
        """Nothing to catch up with: the world is always at its true time."""
        self.hold_up(READ)

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Pass a frame to a board and return its answer."""
        start = self.now
        self.hold_up(f'{EXCHANGE} {board}')
        answer = self.boards.exchange(board, frame)
        self.frames.add(self.now, board, frame, answer)
        self.hold_up(f'{ANSWER} {board}')
        self._exchanged[board] = self.now, self.now - start
        return answer

    def exchange_time(self, board: int) -> float:
        """Duration of the last exchange [s]: that which the bus claims, and the host's delays."""
        return self.boards.exchange_time(board) + self._exchanged[board][1]

    def exchanged_at(self, board: int) -> float:
        """True time at which the last exchange with a board was over [s]."""
        return self._exchanged[board][0]

    def problem(self, board: int) -> str:
        """What the bus says about a board."""
        return self.boards.problem(board)
