"""What is known of a bag, in one line."""

from aerarm_ros.identification.bag_facts import BagFacts


def test_what_is_not_recorded_is_not_mentioned() -> None:
    assert BagFacts('whole bag').text == 'used whole bag'
    assert BagFacts('whole bag', 0, 3).text == 'used whole bag, 0 states lost, 3 cycles missed'
