"""One recording for all that learns from it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from carrying_run import CarryingRun

SEED = -2  # the arm as drawn


@pytest.fixture(scope='session')
def run(made_once: Callable[[str, Callable[[Path], None]], Path]) -> CarryingRun:
    """Return the recording of an arm that picks up 0.2 kg, and puts it down."""

    def fill(folder: Path) -> None:
        CarryingRun.record(SEED).save(folder / 'run.npy')

    return CarryingRun.load(made_once('carrying_run', fill) / 'run.npy', SEED)
