"""Interface for the exchange of frames with boards."""

from typing import Protocol


class Transport(Protocol):
    """Full-duplex exchange of frames with a number of boards.

    Once open, `exchange` never raises and takes a bounded time. An unreachable board returns no
    bytes, and `problem` gives the reason.
    """

    def open(self) -> None:
        """Open the bus; raise TransportError with advice if that fails."""
        ...

    def close(self) -> None:
        """Close the bus; closing again is allowed."""
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
        """End time of the last exchange with a board [s], on the clock of `advance`.

        A board prepares its answer at most one period of its control loop before the exchange
        begins; the exchange begins `exchange_time` before its end.
        """
        ...

    def problem(self, board: int) -> str:
        """Reason why the last exchange with a board failed, '' if it succeeded."""
        ...
