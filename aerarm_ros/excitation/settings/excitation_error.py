"""Errors of this package, all reported to the user as one line that says what to check."""

from typing import Any


class ExcitationError(ValueError):
    """An excitation trajectory cannot be built, loaded or played; the text says what to check."""


class InfeasibleError(ExcitationError):
    """No trajectory inside the limits was found; the text names the limit that binds."""


class NothingDrawnError(InfeasibleError):
    """None of a number of random trajectories is feasible.

    Attributes
    ----------
    binding : the limit that most of them break, in words.
    """

    def __init__(self, message: str, binding: str) -> None:
        super().__init__(message)
        self.binding = binding

    def __reduce__(self) -> tuple[Any, ...]:
        # Workers send it to the process that waits for them.
        return type(self), (str(self), self.binding)


class DesignStoppedError(ExcitationError):
    """A design was stopped before it had a feasible trajectory."""
