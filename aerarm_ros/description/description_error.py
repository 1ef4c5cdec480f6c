"""The error of every unusable robot description."""


class DescriptionError(ValueError):
    """A URDF that can't be used; the message names the joint or link and what to do."""
