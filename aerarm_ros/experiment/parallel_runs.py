"""Runs of many cases, on several processes."""

import multiprocessing
from collections.abc import Generator, Sequence

from aerarm_ros.excitation.design.parallel_design import interrupts_held_back
from aerarm_ros.experiment.experiment_bench import ExperimentBench, ExperimentRun
from aerarm_ros.experiment.experiment_case import ExperimentCase


def run_all(
    bench: ExperimentBench, cases: Sequence[ExperimentCase], workers: int
) -> Generator[ExperimentRun, None, None]:
    """Yield the run of each case, in their order, the same whatever the number of workers.

    Leaving the iteration early ends the workers.

    Parameters
    ----------
    bench
    cases
    workers
        Processes; with one, it is this one.

    Raises
    ------
    RuntimeError
        If the arm was stopped.
    """
    if workers == 1:
        yield from map(bench.run, cases)
        return
    # Started afresh rather than forked: MuJoCo and Pinocchio may have threads.
    with interrupts_held_back():
        pool = multiprocessing.get_context('spawn').Pool(workers)
    with pool:
        yield from pool.imap(bench.run, cases)
