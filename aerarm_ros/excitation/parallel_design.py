"""Trajectory designs from many random initial trajectories, in several processes."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.synchronize import Event
from typing import Any

from aerarm_ros.excitation.settings import DesignStoppedError, InfeasibleError
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    TrajectoryDesigner,
)
from aerarm_ros.realtime.scheduling import THREAD_VARIABLES

Outcome = DesignResult | InfeasibleError

_worker_designer: TrajectoryDesigner | None = None
_worker_stop: Callable[[], bool] | None = None

GRACE = 20.0
"""Time for workers to return their best result after a stop [s]."""


def design_all(
    specification: DesignSpecification,
    starts: int,
    workers: int = 1,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Outcome]:
    """Yield the result of the design from each random start, when it is finished.

    Each start has its own random numbers, so the set of results does not depend on the number of
    workers. Leaving the iteration early ends the workers.

    Parameters
    ----------
    specification : specification of the design.
    starts : number of random starts.
    workers : number of processes, at least one, because this process watches `stop`. Each uses one
        thread, since multi-threaded linear algebra would change the last digits.
    stop : function called ten times per second; once it returns True, running starts yield their
        best result so far, and pending starts yield nothing.
    """
    # Spawned rather than forked, because the parent may have threads (BLAS, a ROS context).
    context = multiprocessing.get_context('spawn')
    stopping = context.Event()
    with _single_threaded_algebra(), interrupts_held_back():
        pool = context.Pool(
            max(1, min(workers, starts)), _prepare_worker, (specification, stopping)
        )
    with pool:
        pending = pool.imap_unordered(_work, range(starts))
        request = _StopRequest(stop, stopping)
        for _ in range(starts):
            try:
                outcome = _next(pending, request)
            except TimeoutError:
                return
            if outcome is not None:
                yield outcome


class _StopRequest:
    """Forward a stop request to the worker processes, and measure the time since then."""

    def __init__(self, stop: Callable[[], bool], stopping: Event) -> None:
        self._stop = stop
        self._stopping = stopping
        self._give_up = math.inf

    def patience_is_over(self) -> bool:
        """Return whether the workers have had their time to react to the stop request."""
        if not self._stopping.is_set() and self._stop():
            self._stopping.set()
            self._give_up = time.monotonic() + GRACE
        return time.monotonic() > self._give_up


def _next(pending: Any, request: _StopRequest) -> Outcome | None:
    """Wait for the next result; raises TimeoutError if workers do not react to a stop."""
    while not request.patience_is_over():
        try:
            outcome: Outcome | None = pending.next(timeout=0.1)
        except multiprocessing.TimeoutError:
            continue
        return outcome
    raise TimeoutError


def _prepare_worker(specification: DesignSpecification, stopping: Event) -> None:
    global _worker_designer, _worker_stop
    _worker_stop = stopping.is_set
    _worker_designer = TrajectoryDesigner(specification)


def _work(start: int) -> Outcome | None:
    assert _worker_designer is not None
    assert _worker_stop is not None
    if _worker_stop():
        return None
    try:
        return _worker_designer.design(start, _worker_stop)
    except InfeasibleError as error:
        return error
    except DesignStoppedError:
        return None


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Block SIGINT in this thread, and permanently in processes started in this context.

    Ctrl-C sends SIGINT to every process of the terminal; only the parent handles it.
    """
    # started now; the pool would start the resource tracker later, which would unblock SIGINT
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _single_threaded_algebra() -> Iterator[None]:
    """Limit the linear algebra of processes started in this context to one thread each."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, '1'))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
