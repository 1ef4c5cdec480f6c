"""What went wrong, on one line of standard error."""

from __future__ import annotations

import contextlib
import sys


def print_error(name: str, error: object) -> None:
    """Print what a user should mend, after the name of the executable."""
    with contextlib.suppress(OSError):  # the terminal may be closed
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr, flush=True)
