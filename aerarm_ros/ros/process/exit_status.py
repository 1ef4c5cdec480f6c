"""How a program ends that a user has to mend, or has ended: a line and a status."""

import os
import sys
from typing import TextIO

USER_ERROR = 2  # what was asked for cannot be done as asked
INTERRUPTED = 130  # ended by Ctrl-C, as shells say it


def print_error(name: str, error: object) -> None:
    """Print an error on one line of standard error, after the name of the executable."""
    _print(f'{name}: {" ".join(str(error).split())}', sys.stderr)


def print_notice(name: str, notice: str) -> None:
    """Print what is under way on standard error; who cannot be told does not end it."""
    _print(f'{name}: {notice}', sys.stderr)


def print_answer(answer: str) -> None:
    """Print an answer on standard output; who cannot be told does not end what goes on."""
    _print(answer, sys.stdout)


def print_account(name: str, account: str) -> None:
    """Print the last words of an executable, if its terminal is still there."""
    _print(f'{name}: {account}', sys.stdout)


def _print(text: str, stream: TextIO) -> None:
    try:
        print(text, file=stream, flush=True)
    except OSError:
        # The terminal is closed. Python tries once more when it ends, and would end with 120.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
