"""Parallel calls of a function in processes.

A run that raises, or whose process is killed, yields a `Failure` and does not affect other runs.
Each result is yielded as soon as the run ends.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from aerarm_ros.realtime.scheduling import THREAD_VARIABLES, use_one_thread

Item = TypeVar('Item')
Result = TypeVar('Result')

_TASKS = 25  # runs of a process before a new process replaces it, which bounds its memory
_unprepared: list[str] = []
"""Error message of the function `prepare` in this worker process; empty without an error."""
_KILLED = (
    'a process was killed twice: check the free memory, and whether another program ends processes'
)


@dataclass(frozen=True)
class Failure:
    """Failed run, with the reason."""

    reason: str


def run_each(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int = 0,
    prepare: Callable[[], None] | None = None,
    leave: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Result | Failure]]:
    """Run a function for each argument; yield run number and result when each run ends.

    If the caller leaves the iteration early, the processes end after their present runs.

    Parameters
    ----------
    function : callable
        Picklable, without side effects: the run of a killed process is repeated.
    items : iterable
        Picklable arguments of `function`, one per run; each is read when its run starts.
    workers : int
        Number of processes; 0 for the number of CPUs.
    prepare : callable, optional
        Picklable; each process calls it once before its first run.
    leave : callable, optional
        Called when the iteration ends early, before it waits for the present runs, for example to
        shorten them.
    """
    workers = workers or os.cpu_count() or 1
    waiting = enumerate(items)
    suspects: deque[tuple[int, Item]] = deque()
    while True:
        # Which of the concurrent runs was killed is unknown, so each is repeated alone.
        alone = bool(suspects)
        source = iter([suspects.popleft()]) if alone else islice(waiting, workers * _TASKS)
        running: dict[Future[Result] | None, tuple[int, Item]] = {}
        pool = _pool(1 if alone else workers, prepare)
        count = 0
        try:
            while True:
                while len(running) < workers and (run := next(source, None)) is not None:
                    count += 1
                    running[None] = run  # until it is submitted, which fails in a broken pool
                    with _surroundings_of_workers():
                        future = pool.submit(_run, function, run[1])
                    running[future] = running.pop(None)
                if not running:
                    break
                for future in wait(filter(None, running), return_when=FIRST_COMPLETED).done:
                    outcome = _outcome(future)
                    yield running.pop(future)[0], outcome
        except BrokenProcessPool:
            lost = sorted(running.values(), key=lambda run: run[0])
            if alone:
                yield from ((index, Failure(_KILLED)) for index, _ in lost)
            else:
                suspects.extend(lost)
        except BaseException:
            if leave is not None:
                leave()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        if not count:
            return


def run_in_order(
    function: Callable[..., Result], arguments: Sequence[tuple[Any, ...]], workers: int = 0
) -> Generator[Result, None, None]:
    """Run a function for each argument; yield the results in the order of the arguments.

    Parameters
    ----------
    function, workers
        As for `run_each`.
    arguments : sequence of tuple
        Picklable positional arguments of `function`, one tuple per run.

    Raises
    ------
    RuntimeError
        If a run has failed.
    """
    results: dict[int, Result] = {}
    following = 0
    for index, outcome in run_each(partial(_call, function), arguments, workers):
        if isinstance(outcome, Failure):
            raise RuntimeError(f'run {index} of {len(arguments)} failed: {outcome.reason}')
        results[index] = outcome
        while following in results:
            yield results.pop(following)
            following += 1


def _call(function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    return function(*arguments)


def _run(function: Callable[[Item], Result], item: Item) -> Result:
    if _unprepared:
        raise RuntimeError(_unprepared[0])
    return function(item)


def _outcome(future: Future[Result]) -> Result | Failure:
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except Exception as error:  # Any exception of a run belongs to that run.
        return Failure(_reason(error))


def _reason(error: BaseException) -> str:
    text = ' '.join(str(error).split())
    return f'{type(error).__name__}: {text}' if text else type(error).__name__


def _pool(workers: int, prepare: Callable[[], None] | None) -> ProcessPoolExecutor:
    # Spawn instead of fork: the parent may have threads (BLAS, a ROS context).
    context = multiprocessing.get_context('spawn')
    return ProcessPoolExecutor(workers, context, _prepare, (prepare,))


def _prepare(prepare: Callable[[], None] | None) -> None:
    """Initialize a worker process: ignore Ctrl-C and call `prepare`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if prepare is None:
        return
    try:
        prepare()
    except Exception as error:  # Each run reports it, because a dead process has no reason.
        _unprepared.append(_reason(error))


@contextmanager
def _surroundings_of_workers() -> Iterator[None]:
    """Context in which started processes block SIGINT and use one linear algebra thread.

    Ctrl-C sends SIGINT to every process of the terminal; only the parent handles it.
    """
    # started now; the pool would start the resource tracker later, which would unblock SIGINT
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # NumPy reads these variables when a worker imports it to unpickle its first argument.
    added = [name for name in THREAD_VARIABLES if name not in os.environ]
    use_one_thread()
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
