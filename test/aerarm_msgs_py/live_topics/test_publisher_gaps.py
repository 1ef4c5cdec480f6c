import random

import pytest

from aerarm_msgs_py.sequence_gaps import UNNUMBERED, PublisherGaps


@pytest.mark.parametrize('seed', range(20))
def test_every_loss_between_first_and_last_is_counted(seed: int) -> None:
    rng = random.Random(seed)
    streams = {}
    lost = 0
    for index in range(rng.randint(1, 6)):
        first = rng.choice([1, 7, 1000])
        kept = [k for k in range(first, first + 30) if rng.random() < 0.7]
        lost += kept[-1] - kept[0] + 1 - len(kept)
        streams[bytes([index])] = kept
    gaps = PublisherGaps()
    while any(streams.values()):
        publisher = rng.choice([x for x, kept in streams.items() if kept])
        gaps.add(streams[publisher].pop(0), publisher)
    assert gaps.lost == lost


def test_repeated_and_late_messages_are_not_counted_as_lost() -> None:
    gaps = PublisherGaps()
    for number in (1, 2, 2, 5, 4, 6):
        gaps.add(number, b'a')
    assert gaps.lost == 2


def test_without_numbers_nothing_is_known() -> None:
    gaps = PublisherGaps()
    for number in UNNUMBERED:
        gaps.add(number, b'a')
    assert gaps.lost is None


def test_without_publishers_it_guesses() -> None:
    gaps = PublisherGaps()
    assert gaps.lost is None
    for number in (1, 2, 5):
        gaps.add(number, None)
    assert gaps.lost == 2
