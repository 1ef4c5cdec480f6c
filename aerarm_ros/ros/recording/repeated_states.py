"""Joint states that were told twice."""

from __future__ import annotations


class RepeatedStates:
    """Finds messages that say once more, to the byte, what the one before has said.

    An emulated arm in lockstep tells its last state again until it is answered. Its stamp is the
    same, so for a bag nothing has happened.

    Attributes
    ----------
    count
        Repetitions so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._last = b''

    def has(self, payload: bytes) -> bool:
        """Take a serialized message; return whether it is a repetition."""
        if payload != self._last:
            self._last = payload
            return False
        self.count += 1
        return True

    @property
    def last(self) -> bytes:
        """The last message, b'' before the first."""
        return self._last
