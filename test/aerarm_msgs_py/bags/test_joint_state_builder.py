"""Joint states collected in bounded memory."""

import numpy as np
import pytest

from aerarm_msgs_py.bags.bag_reader import JointStateBuilder
from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.storage.read_limits import MessageBlock

KIND = 'sensor_msgs/msg/JointState'


def blocks(count: int, size: int = 700) -> list[MessageBlock]:
    """Return messages that are numbered in every field."""
    cdr = JointStateCdr(['a', 'b'])
    found = []
    for first in range(0, count, size):
        numbers = np.arange(first, min(first + size, count))
        payloads = [cdr.pack(int(k) * 10**6, [k, k], [k, -k], [2 * k, k]) for k in numbers]
        found.append(MessageBlock('/x', KIND, numbers + 5, numbers + 1, Payloads.of(payloads)))
    return found


def collected(builder: JointStateBuilder, count: int):
    for block in blocks(count):
        builder.add(block)
    return builder.series()


def test_all_messages_in_order() -> None:
    series = collected(JointStateBuilder(), 10_000)
    numbers = np.arange(10_000)
    np.testing.assert_array_equal(series.velocity, np.column_stack([numbers, -numbers]))
    np.testing.assert_allclose(series.stamp, numbers * 1e-3)
    np.testing.assert_array_equal(series.sequence, numbers + 1)


def test_the_first_ones_up_to_a_limit() -> None:
    builder = JointStateBuilder(most=1000)
    series = collected(builder, 5000)
    np.testing.assert_array_equal(series.position[:, 0], np.arange(1000))
    assert builder.left_out == 4000


@pytest.mark.parametrize('count', [1500, 5000, 20_001])
def test_thinned_messages_are_evenly_spread(count: int) -> None:
    series = collected(JointStateBuilder(thinned=1000), count)
    numbers = series.position[:, 0]
    steps = np.diff(numbers)
    assert steps.min() == steps.max()
    assert numbers[0] == 0
    assert numbers[-1] >= count - steps[0]
    assert len(numbers) < 2000 + 700
    np.testing.assert_allclose(series.log_time * 1e9, numbers + 5)
    np.testing.assert_array_equal(series.sequence, numbers + 1)


def test_joints_that_turn_up_later_get_a_column() -> None:
    builder = JointStateBuilder()
    (block,) = blocks(3)
    builder.add(block)
    later = JointStateCdr(['c']).pack(10, [7.0])
    builder.add(MessageBlock('/x', KIND, np.array([9]), np.array([0]), Payloads.of([later])))
    series = builder.series()
    assert series.names == ('a', 'b', 'c')
    nan = np.nan
    np.testing.assert_array_equal(
        series.position, [[0, 0, nan], [1, 1, nan], [2, 2, nan], [nan, nan, 7]]
    )
