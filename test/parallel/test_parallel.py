"""Runs in processes: a failed or killed run does not affect other runs."""

import os
from functools import partial
from pathlib import Path

import pytest
from parallel_functions import (
    killed_once,
    process_of,
    product,
    refuse,
    square,
    threads_of_algebra,
    wait_for,
)

from aerarm_ros.parallel import Failure, run_each, run_in_order


@pytest.mark.parametrize('workers', [1, 2])
def test_an_exception_is_a_failure_with_its_reason(workers: int) -> None:
    found = dict(run_each(square, range(6), workers))
    assert found.pop(3) == Failure('ValueError: three is refused')
    assert found == {number: number * number for number in (0, 1, 2, 4, 5)}


def test_a_killed_process_loses_nothing(tmp_path: Path) -> None:
    found = dict(run_each(partial(killed_once, folder=tmp_path), range(8), 2))
    refused = found.pop(5)
    assert isinstance(refused, Failure)
    assert 'killed twice' in refused.reason
    assert found == {number: number for number in (0, 1, 2, 3, 4, 6, 7)}


def test_processes_are_replaced() -> None:
    found = dict(run_each(process_of, range(60), 1))
    assert len(set(found.values())) == 3


def test_a_process_that_cannot_be_prepared_gives_its_reason() -> None:
    found = dict(run_each(square, range(3), 2, prepare=refuse))
    assert set(found.values()) == {Failure('RuntimeError: ValueError: no licence')}
    assert len(found) == 3


def test_an_early_end_can_shorten_the_present_runs(tmp_path: Path) -> None:
    mark = tmp_path / 'leave'
    (tmp_path / 'first').touch()
    runs = run_each(wait_for, [tmp_path / 'first', mark], 2, leave=mark.touch)
    assert next(runs) == (0, True)
    runs.close()  # would wait for ever without the mark
    assert mark.exists()


def test_processes_use_one_thread_of_linear_algebra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('OMP_NUM_THREADS', raising=False)
    assert dict(run_each(threads_of_algebra, range(1), 1)) == {0: '1'}
    assert 'OMP_NUM_THREADS' not in os.environ


def test_results_come_in_the_order_of_the_arguments() -> None:
    pairs = [(number, 2) for number in range(4)]
    assert list(run_in_order(product, pairs, 2)) == [0, 2, 4, 6]
    with pytest.raises(RuntimeError, match='run 2 of 3 failed: ValueError: four is refused'):
        list(run_in_order(product, [(1, 1), (2, 1), (4, 1)], 2))
