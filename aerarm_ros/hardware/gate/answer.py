"""Outcome of a request."""

from typing import NamedTuple


class Answer(NamedTuple):
    """Whether a request was accepted, and what happens now or why not."""

    accepted: bool
    message: str
