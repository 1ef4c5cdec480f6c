"""Errors of this package, all reported to the user as one line that says what to check."""


class ExcitationError(ValueError):
    """An excitation trajectory cannot be built, loaded or played; the text says what to check."""


class InfeasibleError(ExcitationError):
    """No trajectory inside the limits was found; the text names the limit that binds."""


class DesignStoppedError(ExcitationError):
    """A design was stopped before it had a feasible trajectory."""
