"""Run one function many times, in processes of this computer or of a Ray cluster.

A run that raises, or whose process is killed, yields a `Failure` and does not affect other runs.
Each result is yielded as soon as the run ends.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import resource
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

from aerarm_ros.realtime.scheduling import use_one_thread

Item = TypeVar('Item')
Result = TypeVar('Result')

LOCAL = 'local'
"""Ray's address of a cluster that is started on this computer for the runs."""
_TASKS = 25  # runs of a process before a new process replaces it, which bounds its memory
_GIB = 2**30
_KILLED = (
    'a process was killed twice: check the free memory, and whether another program ends processes'
)


@dataclass(frozen=True)
class Failure:
    """Reason why a run has no result.

    Attributes
    ----------
    is_final : bool
        Whether a repetition would fail too; False if the process was ended from outside.
    """

    reason: str
    is_final: bool = True


def run_each(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int = 0,
    memory: float = 0.0,
) -> Iterator[tuple[int, Result | Failure]]:
    """Yield the number and the result of each run as soon as the run ends.

    If the caller leaves the iteration early, the processes end after their present runs.

    Parameters
    ----------
    function : callable
        Picklable, without side effects: the run of a killed process is repeated.
    items : sequence
        Picklable arguments of `function`, one per run.
    workers : int
        Number of processes; 0 for the number of CPUs.
    memory : float
        Memory limit of each process [GiB]; 0 for no limit.
    """
    workers = workers or os.cpu_count() or 1
    waiting = deque(range(len(items)))
    suspects: deque[int] = deque()
    while waiting or suspects:
        # Which of the concurrent runs was killed is unknown, so each is repeated alone.
        alone = bool(suspects)
        source, count = (suspects, 1) if alone else (waiting, workers * _TASKS)
        batch = deque(source.popleft() for _ in range(min(count, len(source))))
        running: dict[Future[Result], int] = {}
        pool = _pool(1 if alone else min(workers, len(batch)), memory)
        try:
            while batch or running:
                while batch and len(running) < workers:
                    future = pool.submit(function, items[batch[0]])
                    running[future] = batch.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    outcome = _outcome(future)
                    yield running.pop(future), outcome
        except BrokenProcessPool:
            lost = sorted(running.values())
            if alone:
                yield from ((index, Failure(_KILLED, is_final=False)) for index in lost or batch)
            else:
                suspects.extend(lost)
                waiting.extendleft(reversed(batch))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def run_each_on_ray(
    function: Callable[[Item], Result], items: Sequence[Item], address: str = LOCAL
) -> Iterator[tuple[int, Result | Failure]]:
    """Yield the number and the result of each run on a Ray cluster.

    Parameters
    ----------
    function, items
        As for `run_each`. Files that items name must exist on every computer.
    address : str
        Ray's address of an existing cluster; 'local' starts a cluster on this computer.

    Raises
    ------
    RuntimeError
        If Ray is not installed or the cluster does not answer.
    """
    try:
        import ray
    except ImportError:
        raise RuntimeError("Ray is not installed: pip install 'aerarm_ros[ray]'") from None
    use_one_thread()
    try:
        ray.init(
            address=None if address == LOCAL else address,
            include_dashboard=False if address == LOCAL else None,
            runtime_env=_here() if address == LOCAL else None,
            log_to_driver=False,
            logging_level=logging.WARNING,
        )
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise RuntimeError(
            f'Ray at {address} does not respond ({error}): check that the cluster runs'
        ) from None
    try:

        def run(item: Item) -> Result:
            return function(item)

        remote = ray.remote(max_retries=1)(run)
        pending: dict[Any, int] = {remote.remote(item): k for k, item in enumerate(items)}
        while pending:
            (done,), _ = ray.wait(list(pending), num_returns=1)
            index = pending.pop(done)
            try:
                yield index, ray.get(done)
            except ray.exceptions.RayTaskError as error:
                yield index, Failure(_reason(error.cause))
            except ray.exceptions.RayError as error:
                yield index, Failure(str(error).splitlines()[0], is_final=False)
    finally:
        ray.shutdown()


def _here() -> dict[str, Any]:
    """Return Ray's runtime environment with this process's module search path."""
    return {'env_vars': {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}}


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


def _pool(workers: int, memory: float) -> ProcessPoolExecutor:
    # Spawn instead of fork: the parent may have threads (BLAS, a ROS context).
    context = multiprocessing.get_context('spawn')
    return ProcessPoolExecutor(workers, context, _prepare, (memory,))


def _prepare(memory: float) -> None:
    """Prepare a worker process: ignore Ctrl-C, which the parent handles, and limit the memory."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_one_thread()
    if memory > 0.0:
        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (int(memory * _GIB), most))
