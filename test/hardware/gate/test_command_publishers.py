import numpy as np
import pytest

from aerarm_ros.hardware.gate.command_publishers import _MEMORY, _WINDOW, CommandPublishers

PERIOD = 1e-3


def sources(publishers, numbers, start=0.0):
    """Return the sources of messages that arrive once a millisecond."""
    return [publishers.judge(number, start + k * PERIOD)[0] for k, number in enumerate(numbers)]


def test_one_publisher_is_one_source_whatever_is_lost():
    publishers = CommandPublishers()
    numbers = np.cumsum(np.random.default_rng(1).integers(1, 60, 2000)).tolist()
    assert len(set(sources(publishers, numbers))) == 1


@pytest.mark.parametrize('lead', [-4800, 150, 5000])
def test_two_publishers_are_two_sources(lead):
    publishers = CommandPublishers()
    (first,) = set(sources(publishers, range(5000, 5100)))
    numbers = [n for k in range(5100, 5400) for n in (k, k + lead)]
    both = sources(publishers, numbers, start=0.1)
    assert set(both[0::2]) == {first}
    (second,) = set(both[1::2])
    assert second not in (first, None)


@pytest.mark.parametrize('lead', [1, 7, 90])
def test_two_that_start_at_the_same_time_are_not_told_apart(lead):
    publishers = CommandPublishers()
    numbers = [n for k in range(1, 300) for n in (k, k + lead)]
    assert set(sources(publishers, numbers)[2 * lead + 2 :]) == {None}
    # One of them ends: the other has the arm for itself again.
    assert sources(publishers, range(400, 700), start=1.0)[-1] is not None


def test_a_restarted_controller_is_a_new_source():
    publishers = CommandPublishers()
    assert len(set(sources(publishers, [900, 901, 1, 2, 3]))) == 2


def test_a_publisher_long_silent_is_forgotten():
    publishers = CommandPublishers()
    old, _ = publishers.judge(500, 0.0)
    # A controller started later passes the number at which the first one ended.
    (late,) = set(sources(publishers, range(450, 600), start=60.0))
    assert late not in (old, None)


def test_memory_is_bounded():
    publishers = CommandPublishers()
    sources(publishers, np.random.default_rng(2).integers(1, 10**9, 5000).tolist())
    assert len(publishers._streams) <= 16


@pytest.mark.parametrize('number', [0, 2**64 - 1])
def test_without_numbers_two_publishers_cannot_be_told_apart(number):
    publishers = CommandPublishers()
    publishers.look(['/a'])
    assert sources(publishers, [number] * 5) == [0] * 5
    publishers.look(['/a', '/b'])
    assert sources(publishers, [number]) == [None]


@pytest.mark.parametrize('allowed', ['controller', '/arm/controller', 'arm/controller'])
def test_an_allowed_publisher_may_command_once_it_was_seen(allowed):
    publishers = CommandPublishers([allowed])
    assert publishers.judge(1, 0.0)[1] is False
    publishers.look(['/arm/controller'])
    assert publishers.judge(0, 0.0)[1]  # also without numbers
    assert publishers.judge(2, 0.001)[1]
    assert publishers.warning == ''


def test_an_intruder_neither_commands_nor_disturbs():
    publishers = CommandPublishers(['controller'])
    publishers.judge(1, 0.0)
    publishers.look(['/controller'])
    assert publishers.judge(2, 0.001)[1]
    assert not publishers.judge(700, 0.002)[1]
    publishers.look(['/intruder', '/controller'])
    assert not publishers.judge(701, 0.003)[1]
    assert publishers.judge(3, 0.004)[1]
    assert '/intruder publishes joint_command without being' in publishers.warning


def test_who_comes_while_an_intruder_is_there_may_not_command():
    publishers = CommandPublishers(['controller'])
    publishers.judge(1, 0.0)
    publishers.look(['/intruder', '/controller'])
    assert not publishers.judge(2, 0.05)[1]
    publishers.look(['/controller'])
    assert publishers.judge(3, 0.1)[1]


def test_more_than_one_publisher_is_a_warning():
    publishers = CommandPublishers()
    publishers.look(['/b', '/a'])
    assert publishers.names == ('/a', '/b')
    assert '2 publishers (/a, /b)' in publishers.warning
    assert publishers.judge(1, 0.0)[1]


def test_sources_are_counted_so_that_a_new_one_is_noticed():
    publishers = CommandPublishers()
    sources(publishers, range(1, 50))
    assert publishers.sources == 1
    sources(publishers, range(50, 100), start=0.05)
    assert publishers.sources == 1
    sources(publishers, range(1, 50), start=10.0)
    assert publishers.sources == 2


def test_what_is_one_publisher_has_an_exact_border():
    """Numbers up to a window apart are one publisher's, for as long as it is remembered."""
    publishers = CommandPublishers()
    first, _ = publishers.judge(10_000, 0.0)
    assert publishers.judge(10_000 + _WINDOW, _MEMORY) == (first, True)
    second, _ = publishers.judge(10_000 + 2 * _WINDOW + 1, _MEMORY)
    assert second not in (first, None)
    assert publishers.judge(10_000 + _WINDOW + 1, _MEMORY + 1e-3)[0] == first
    # Heard longer ago than is remembered, both are forgotten.
    third, _ = publishers.judge(10_000 + _WINDOW + 2, 2.0 * _MEMORY + 2e-3)
    assert third not in (first, second, None)
    assert publishers.sources == 3


def test_between_two_publishers_the_nearer_and_else_the_first_is_it():
    publishers = CommandPublishers()
    first, _ = publishers.judge(10_000, 0.0)
    publishers.judge(10_000 + 2 * _WINDOW, 0.0)
    assert publishers.sources == 2
    assert publishers.judge(10_000 + _WINDOW, 0.001)[0] == first


def test_a_number_that_goes_back_makes_its_publisher_unknown_for_as_long_as_remembered():
    publishers = CommandPublishers()
    source, _ = publishers.judge(100, 0.0)
    assert publishers.judge(100, 0.0)[0] is None
    assert publishers.judge(101, _MEMORY)[0] is None
    assert publishers.judge(102, _MEMORY + 1e-3)[0] == source


def test_before_anybody_looked_there_is_no_publisher():
    assert CommandPublishers().names == ()
    assert CommandPublishers().warning == ''
