"""Answers of a node to states, including re-sent states."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher


class Answers:
    """Publish answers to states, and republish them when a state is re-sent.

    Best-effort messages can be lost. So an emulated arm that waits for an answer re-sends its last
    state byte for byte. A state that was answered gets the same answer again. All other code
    receives each state once.

    Parameters
    ----------
    needed
        Whether the node must process a re-sent state that it did not answer.

    Attributes
    ----------
    state
        The newest state, serialized; b'' before the first.
    count
        Number of re-sent states.
    """

    def __init__(self, *, needed: bool = True) -> None:
        self.state = b''
        self.count = 0
        self._needed = needed
        self._is_resent = self._is_answered = False
        self._kept: dict[Publisher, Any] = {}

    def begin(self, state: bytes) -> bool:
        """Store a serialized state; return whether it is a re-sent copy of the last one."""
        self._is_resent = state == self.state
        if self._is_resent:
            self.count += 1
        else:
            self.state, self._is_answered = state, not self._needed
        return self._is_resent

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Publish a message, serialized or not, in answer to the newest state."""
        publisher.publish(message)
        self._kept[publisher] = message
        self._is_answered = True

    def again(self) -> bool:
        """Republish the last answers if the newest state is re-sent and was answered.

        Return whether the answers were republished; in that case the state needs no processing.
        """
        if not (self._is_resent and self._is_answered):
            return False
        for publisher, message in self._kept.items():
            publisher.publish(message)
        return True

    def withdraw(self) -> None:
        """Discard the answers, which are no longer valid."""
        self._kept.clear()
        self._is_answered = not self._needed

    @property
    def is_resent(self) -> bool:
        """Whether the newest state is a re-sent copy."""
        return self._is_resent

    @property
    def are_kept(self) -> bool:
        """Whether an answer was published since the last withdrawal."""
        return bool(self._kept)
