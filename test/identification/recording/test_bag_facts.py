"""What is known of a bag, in one line."""

import pytest

from aerarm_ros.identification.recording.recording import BagFacts


def test_unrecorded_facts_are_not_mentioned() -> None:
    assert BagFacts('whole bag').text == 'used whole bag'
    assert BagFacts('whole bag', 0, 3).text == 'used whole bag, 0 states lost, 3 cycles missed'


@pytest.mark.parametrize(
    ('facts', 'states', 'said'),
    [
        (BagFacts('', 0, 1207), 25_032, 'bag: 4.6 % of the cycles were missed, '),
        (BagFacts('', 100, 11), 889, 'bag: 1.1 % of the cycles were missed, '),
        (BagFacts('', None, 11), 989, 'bag: 1.1 % of the cycles were missed, '),
    ],
)
def test_many_missed_cycles_are_warned_of(facts: BagFacts, states: int, said: str) -> None:
    (warning,) = facts.warnings('bag', states)
    assert warning.startswith(said)
    assert 'config/parameters_spi.yaml' in warning


@pytest.mark.parametrize(
    ('facts', 'states'), [(BagFacts('', 0, 10), 990), (BagFacts('', 100), 900), (BagFacts(''), 0)]
)
def test_a_cycle_in_a_hundred_does_no_harm(facts: BagFacts, states: int) -> None:
    assert not facts.warnings('bag', states)
