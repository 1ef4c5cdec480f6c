"""Designs from many starts, on several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from aerarm_ros.excitation.design_specification import DesignSpecification
from aerarm_ros.excitation.excitation_error import InfeasibleError
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner

Outcome = DesignResult | InfeasibleError

_worker_designer: TrajectoryDesigner | None = None


def design_all(
    specification: DesignSpecification,
    starts: int,
    workers: int = 1,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Outcome]:
    """Yield the outcome of each start as it is finished.

    Each start has random numbers of its own, so the set of results does not depend on the
    number of workers. Leaving the iteration early ends the workers.

    Parameters
    ----------
    specification : what is to be designed.
    starts : how many random starts.
    workers : processes, at least one: this one keeps watching `stop`, and linear algebra on
        several threads would give other last digits than on one.
    stop : asked ten times a second; True ends the iteration.
    """
    # Started afresh rather than forked: the parent may have threads (BLAS, a ROS context).
    context = multiprocessing.get_context('spawn')
    with _single_threaded_algebra():
        pool = context.Pool(max(1, min(workers, starts)), _prepare_worker, (specification,))
    with pool:
        pending = pool.imap_unordered(_work, range(starts))
        for _ in range(starts):
            outcome = _next(pending, stop)
            if outcome is None:
                return
            yield outcome


def _next(pending: object, stop: Callable[[], bool]) -> Outcome | None:
    """Wait for the next outcome, or return None as soon as a stop is asked for."""
    while not stop():
        try:
            return pending.next(timeout=0.1)  # type: ignore[attr-defined, no-any-return]
        except multiprocessing.TimeoutError:
            continue
    return None


def _attempt(designer: TrajectoryDesigner, start: int) -> Outcome:
    try:
        return designer.design(start)
    except InfeasibleError as error:
        return error


def _prepare_worker(specification: DesignSpecification) -> None:
    # A Ctrl-C reaches every process of the terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    global _worker_designer
    _worker_designer = TrajectoryDesigner(specification)


def _work(start: int) -> Outcome:
    assert _worker_designer is not None
    return _attempt(_worker_designer, start)


@contextmanager
def _single_threaded_algebra() -> Iterator[None]:
    """Keep the children's linear algebra from using more threads than there are workers."""
    names = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, '1'))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
