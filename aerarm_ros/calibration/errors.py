"""Errors of calibration."""


class CalibrationError(ValueError):
    """Data or an option that cannot be used; the message says where, and what to check."""
