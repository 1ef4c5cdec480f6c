"""Runs in processes: a failed or killed run does not affect other runs."""

from functools import partial
from pathlib import Path

import pytest
from parallel_functions import hungry, killed_once, limit_and_process, square

from aerarm_ros.parallel import Failure, run_each, run_each_on_ray


@pytest.mark.parametrize('workers', [1, 2])
def test_an_exception_is_a_failure_with_its_reason(workers: int) -> None:
    found = dict(run_each(square, range(6), workers))
    assert found.pop(3) == Failure('ValueError: three is refused')
    assert found == {number: number * number for number in (0, 1, 2, 4, 5)}


def test_a_killed_process_loses_nothing(tmp_path: Path) -> None:
    found = dict(run_each(partial(killed_once, folder=tmp_path), range(8), 2))
    refused = found.pop(5)
    assert isinstance(refused, Failure)
    assert not refused.is_final
    assert 'killed twice' in refused.reason
    assert found == {number: number for number in (0, 1, 2, 3, 4, 6, 7)}


def test_memory_of_a_process_has_a_limit() -> None:
    found = dict(run_each(hungry, [1, 3000], 1, memory=1.0))
    assert found[0] == 2**20
    assert found[1] == Failure('MemoryError')


def test_processes_are_replaced() -> None:
    found = dict(run_each(limit_and_process, range(60), 1, memory=2.0))
    assert {limit for limit, _ in found.values()} == {2**31}
    assert len({process for _, process in found.values()}) == 3


def test_ray_gives_the_same() -> None:
    pytest.importorskip('ray', reason='Ray is not installed: pip install aerarm_ros[ray]')
    assert dict(run_each_on_ray(square, range(6))) == dict(run_each(square, range(6), 2))
