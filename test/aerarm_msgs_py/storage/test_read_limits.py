from pathlib import Path

import pytest

from aerarm_msgs_py.storage.read_limits import BagError, ReadBudget, ReadLimits


@pytest.mark.parametrize(
    'wrong', [{'ratio': 0.0}, {'ratio': float('nan')}, {'part_bytes': 0}, {'ratio': float('inf')}]
)
def test_a_limit_is_a_positive_number(wrong: dict[str, float]) -> None:
    with pytest.raises(BagError, match='set it to 1 or more'):
        ReadLimits(**wrong)


def test_the_memory_of_a_bag_is_limited_to_a_multiple_of_its_size() -> None:
    budget = ReadBudget(Path('bag'), 10_000_000, ReadLimits(ratio=3.0))
    budget.spend(20_000_000)
    budget.spend(10_000_000)
    with pytest.raises(BagError, match='10000000 bytes needs more than 3 times this size'):
        budget.spend(1)


def test_a_small_bag_may_become_some_megabytes() -> None:
    ReadBudget(Path('bag'), 1, ReadLimits(ratio=1.0)).spend(4_000_000)
