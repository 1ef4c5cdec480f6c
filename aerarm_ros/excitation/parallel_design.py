"""Trajectory designs from many random initial trajectories, in several processes."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from aerarm_ros.excitation.settings import DesignStoppedError, InfeasibleError
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    TrajectoryDesigner,
)
from aerarm_ros.parallel import Failure, run_each

Outcome = DesignResult | InfeasibleError

_worker: _Worker | None = None

GRACE = 20.0
"""Time that worker processes have to return their best result after a stop request [s]."""
_INTERVAL = 0.1  # [s] between two checks of the stop request


def design_all(
    specification: DesignSpecification,
    starts: int,
    workers: int = 1,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Outcome]:
    """Yield the result of each design, one per random start, as soon as the design is finished.

    Each start has its own random numbers, so the set of results does not depend on the number of
    workers. Leaving the iteration early ends the workers.

    Parameters
    ----------
    specification : specification of the design.
    starts : number of random starts.
    workers : number of processes. Each uses one thread, since multi-threaded linear algebra would
        change the last digits.
    stop : function called ten times per second in a thread; once it returns True, running starts
        yield their best result so far, and pending starts yield nothing.

    Raises
    ------
    RuntimeError
        If a design fails for another reason than an infeasible start.
    """
    stopping = multiprocessing.get_context('spawn').RawValue('b', False)
    ended = threading.Event()

    def leave() -> None:
        stopping.value = True

    def watch() -> None:
        try:
            while not ended.wait(_INTERVAL) and not stop():
                pass
        finally:
            leave()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        worker = _Worker(specification, stopping)
        numbers = takewhile(lambda _: not worker.is_stopping(), range(starts))
        runs = run_each(_work, numbers, workers, prepare=worker.prepare, leave=leave)
        for _, outcome in runs:
            if isinstance(outcome, Failure):
                raise RuntimeError(f'a design failed: {outcome.reason}')
            if outcome is not None:
                yield outcome
    finally:
        ended.set()
        watcher.join()


@dataclass
class _Worker:
    """State of a worker process: its designer and the request to stop."""

    specification: DesignSpecification
    stopping: Any  # shared flag without a lock, because a killed process would keep the lock
    designer: TrajectoryDesigner | None = None

    def is_stopping(self) -> bool:
        """Return whether a stop was requested."""
        return bool(self.stopping.value)

    def prepare(self) -> None:
        """Prepare a worker process: build the designer, and watch for a stop request."""
        global _worker
        _worker = self
        self.designer = TrajectoryDesigner(self.specification)
        threading.Thread(target=self._end_after_stop, daemon=True).start()

    def _end_after_stop(self) -> None:
        # A design that does not react to the stop request must not hold up the program for ever.
        while not self.is_stopping():
            time.sleep(_INTERVAL)
        time.sleep(GRACE)
        os._exit(1)


def _work(start: int) -> Outcome | None:
    assert _worker is not None
    assert _worker.designer is not None
    if _worker.is_stopping():
        return None
    try:
        return _worker.designer.design(start, _worker.is_stopping)
    except InfeasibleError as error:
        return error
    except DesignStoppedError:
        return None
