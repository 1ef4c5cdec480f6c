"""One recording for all estimators."""

from collections.abc import Callable
from pathlib import Path

import pytest
from carrying_run import CarryingRun
from touched_run import learnt, recording

from aerarm_ros.online.external_torque import ResidualBound

SEED = -2  # the arm as drawn


@pytest.fixture(scope='session')
def run(made_once: Callable[[str, Callable[[Path], None]], Path]) -> CarryingRun:
    """Return the recording of an arm that picks up 0.2 kg, and puts it down."""

    def fill(folder: Path) -> None:
        CarryingRun.record(SEED).save(folder / 'run.npy')

    return CarryingRun.load(made_once('carrying_run', fill) / 'run.npy', SEED)


@pytest.fixture(scope='session')
def free(made_once: Callable[[str, Callable[[Path], None]], Path]) -> CarryingRun:
    """Return another motion of that arm, without a payload."""

    def fill(folder: Path) -> None:
        CarryingRun.record(-5, pick_up=90.0, put_down=91.0, end=9.0).save(folder / 'run.npy')

    return CarryingRun.load(made_once('free_run', fill) / 'run.npy', -5)


@pytest.fixture(scope='session')
def loaded(made_once: Callable[[str, Callable[[Path], None]], Path]) -> CarryingRun:
    """Return a third motion, in which the arm picks up 0.2 kg after 2 s and keeps it."""

    def fill(folder: Path) -> None:
        CarryingRun.record(-4, pick_up=2.0, put_down=91.0, end=7.5).save(folder / 'run.npy')

    return CarryingRun.load(made_once('loaded_run', fill) / 'run.npy', -4, pick_up=2.0)


@pytest.fixture(scope='session')
def bound(free: CarryingRun) -> ResidualBound:
    """Return thresholds that are learnt from the free motion."""
    return learnt(free, recording(free, 0.7, 9.0))
