import random

import pytest

from aerarm_msgs_py.sequence_gaps import SequenceGaps


def lost(numbers) -> int | None:
    gaps = SequenceGaps()
    gaps.add_all(numbers)
    return gaps.lost


def test_counts_messages_missing_between_first_and_last() -> None:
    assert lost(range(1, 1000)) == 0
    assert lost(range(500, 1000)) == 0  # joined late
    assert lost([1, 2, 5, 6, 10]) == 5


def test_a_restarted_publisher_loses_nothing() -> None:
    assert lost([*range(1, 500), *range(1, 800)]) == 0


@pytest.mark.parametrize('first', [1, 4000, 900_000])
def test_publishers_may_be_interleaved(first: int) -> None:
    rng = random.Random(1)
    streams = [list(range(20_000, 22_000)), list(range(first, first + 2000))]
    mixed = []
    while any(streams):
        stream = rng.choice([x for x in streams if x])
        mixed.append(stream.pop(0))
    assert lost(mixed) == 0
    del mixed[1000:1010]
    assert lost(mixed) == 10


def test_unnumbered_messages_are_not_counted() -> None:
    assert lost([0, 0, 0]) is None
    assert lost([2**64 - 1] * 3) is None
    assert lost([]) is None
