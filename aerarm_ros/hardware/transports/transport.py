"""How frames get to the boards and back."""

from typing import Protocol


class Transport(Protocol):
    """Full-duplex exchange of frames with a number of boards.

    Once open, `exchange` never raises and takes a bounded time: a board that can't be
    reached answers with no bytes, and `problem` says why.
    """

    def open(self) -> None:
        """Open the bus; raises TransportError with what to check."""
        ...

    def close(self) -> None:
        """Release the bus; a closed transport may be closed again."""
        ...

    def advance(self, now: float) -> None:
        """Advance the boards to the cycle's time [s, monotonic]; only emulated boards use it."""
        ...

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Send a frame to a board and return the received one; b'' if none arrived."""
        ...

    def exchange_time(self, board: int) -> float:
        """Duration of the last exchange with a board [s]."""
        ...

    def exchanged_at(self, board: int) -> float:
        """When the last exchange with a board ended [s], on the clock of `advance`.

        A board's answer was made after the exchange began, which is `exchange_time` earlier, or
        less than a period of the board's loop before.
        """
        ...

    def problem(self, board: int) -> str:
        """Why the last exchange with a board failed, '' if it didn't."""
        ...
