"""Functions for other processes, which import them from this module."""

import os
import signal
import time
from pathlib import Path


def square(number: int) -> int:
    if number == 3:
        raise ValueError('three is\nrefused')
    return number * number


def killed_once(number: int, folder: Path) -> int:
    """Return the number; the process of 2 is killed the first time, that of 5 every time."""
    mark = folder / 'killed'
    if number == 5 or (number == 2 and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def process_of(_: int) -> int:
    return os.getpid()


def refuse() -> None:
    raise ValueError('no licence')


def threads_of_algebra(_: int) -> str:
    return os.environ['OMP_NUM_THREADS']


def wait_for(path: Path) -> bool:
    while not path.exists():
        time.sleep(0.01)
    return True


def product(one: int, other: int) -> int:
    if one == 4:
        raise ValueError('four is refused')
    time.sleep(0.1 * (one == 0))  # the first run ends last
    return one * other
