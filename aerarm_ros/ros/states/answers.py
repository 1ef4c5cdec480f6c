"""What a node publishes in answer to states, and the only place that notices a re-sent state."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher


class Answers:
    """Publishes answers to states, and publishes them once more when the state is re-sent.

    Messages of best effort can be lost. An emulated arm whose time waits for an answer therefore
    re-sends its last state, to the byte. What has been answered then needs the same answer, and
    nothing else: for everybody behind this class, each state comes once.

    Parameters
    ----------
    needed
        Whether a state without an answer is given to the node once more when it is re-sent.

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
        """Take a serialized state; return whether it is the last one, re-sent."""
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
        """Publish the last answers once more if the newest state is re-sent and was answered.

        Returns whether that is so: then there is nothing else to do.
        """
        if not (self._is_resent and self._is_answered):
            return False
        for publisher, message in self._kept.items():
            publisher.publish(message)
        return True

    def withdraw(self) -> None:
        """Forget the answers: they hold no more."""
        self._kept.clear()
        self._is_answered = not self._needed

    @property
    def is_resent(self) -> bool:
        """Whether the newest state came once more."""
        return self._is_resent

    @property
    def are_kept(self) -> bool:
        """Whether anything was answered since the last withdrawal."""
        return bool(self._kept)
