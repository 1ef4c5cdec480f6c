"""The error of every recording that can't be identified from."""


class IdentificationError(ValueError):
    """Data or an option that can't be used; the message says what to check."""
