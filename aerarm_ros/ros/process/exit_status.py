"""How a program ends that a user has to mend, or has ended: a line and a status."""

import contextlib
import sys

USER_ERROR = 2  # what was asked for cannot be done as asked
INTERRUPTED = 130  # ended by Ctrl-C, as shells say it


def print_error(name: str, error: object) -> None:
    """Print an error on one line of standard error, after the name of the executable."""
    with contextlib.suppress(OSError):  # the terminal may be closed
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr, flush=True)
