"""Emulated boards and arm that continue in true time during all delays of the host."""

from collections.abc import Callable

from frame_log import FrameLog

from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport

_PIECE = 1e-3  # [s] between checks of the arm; less than the boards' longest step

# Points at which the host may be delayed in a cycle; for an exchange, the example is board 0.
WAKE = 'wake'  # before the host reads its clock
READ = 'read'  # between reading the clock and the first exchange
EXCHANGE = 'exchange'  # ('exchange 0') before the frame is on the bus
ANSWER = 'answer'  # ('answer 0') after the frame, before the answer is read

Delays = Callable[[int, str], float]


class AttackWorld:
    """A `Transport` to emulated boards that records every frame, and the host's clock.

    Time advances by the host's delays, `delays(cycle, point)` in seconds, and to the next cycle.
    Boards and plant continue meanwhile, and the boards' time-outs apply, as with a real host.

    Parameters
    ----------
    boards
        The emulated boards on their plant.
    watch
        Called every millisecond of true time, delays of the host included, with that time [s].

    Attributes
    ----------
    now
        True time, which is the host's clock [s, monotonic].
    frames
        Every frame of the run.
    cycle
        Number of the host's cycle, for the delays.
    """

    def __init__(self, boards: EmulatedTransport, watch: Callable[[float], None]) -> None:
        self.boards = boards
        self.now = 100.0
        self.frames = FrameLog()
        self.cycle = 0
        self._watch = watch
        self._delays: Delays | None = None
        self._exchanged = [(0.0, 0.0) for _ in boards.boards]  # of the last exchange: end, duration
        boards.advance(self.now)

    def script(self, delays: Delays | None) -> None:
        """Set other delays of the host."""
        self._delays = delays

    def clock(self) -> float:
        """Return the host's clock [s]."""
        return self.now

    def pass_time(self, until: float) -> None:
        """Simulate boards and arm until a true time [s]."""
        while until > self.now:
            self.now = until if until - self.now < 1.001 * _PIECE else self.now + _PIECE
            self.boards.advance(self.now)
            self._watch(self.now)

    def hold_up(self, point: str) -> None:
        """Delay the host according to its script."""
        if self._delays is not None:
            seconds = self._delays(self.cycle, point)
            if seconds > 0.0:
                self.pass_time(self.now + seconds)

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def advance(self, now: float) -> None:
        """Do nothing: the simulation is always at its true time."""
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
        """Duration of the last exchange [s]: the bus' own, plus the host's delays."""
        return self.boards.exchange_time(board) + self._exchanged[board][1]

    def exchanged_at(self, board: int) -> float:
        """True time at the end of the last exchange with a board [s]."""
        return self._exchanged[board][0]

    def problem(self, board: int) -> str:
        """Bus problem of a board."""
        return self.boards.problem(board)
