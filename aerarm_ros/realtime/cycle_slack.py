"""The time between the end of a cycle and the next one, for another thread."""

from threading import Event

_PATIENCE = 5e-3  # [s] some cycles: nobody has to wait for a loop that stands still


class CycleSlack:
    """Lets another thread begin its work where a loop has just ended a cycle.

    Two threads of Python share one interpreter, and a loop that wakes while the other one
    computes gets it back late, at each of its own system calls anew. A piece of work that
    begins with the slack is over, if it is short, before the loop wakes.
    """

    def __init__(self) -> None:
        self._begun = Event()

    def begin(self) -> None:
        """Say that a cycle is over; for the loop, takes 0.1 us if nobody waits."""
        if not self._begun.is_set():
            self._begun.set()

    def wait(self) -> None:
        """Wait for the end of a cycle, 5 ms at most."""
        self._begun.clear()
        self._begun.wait(_PATIENCE)
