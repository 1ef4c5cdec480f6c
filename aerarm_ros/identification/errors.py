"""Exceptions raised by the identification."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class IdentificationError(ValueError):
    """Error for unusable data or options; the message states what to check."""


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Convert an OSError from reading a file to an IdentificationError with the path.

    Raises
    ------
    IdentificationError
        If the file cannot be read.
    """
    try:
        yield
    except OSError as error:
        raise IdentificationError(
            f'{path} cannot be read ({error.strerror or error}): check the path'
        ) from None
