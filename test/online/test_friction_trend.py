import numpy as np
import pytest

from aerarm_ros.online.friction_trend import MOST, WEEK, FrictionRecord, FrictionTrend

NAMES = ('joint1', 'joint2')
START = 1.8e9
FRICTION = np.array([[0.01, 0.02], [0.2, 0.1], [0.04, 0.02]])
STD = 0.02 * FRICTION


def week_of_use(count: int, wear: float, seed: int = 0) -> list[FrictionRecord]:
    """Return records as uncertain as they say, Coulomb friction of joint2 growing by a share."""
    random = np.random.default_rng(seed)
    records = []
    for share in np.linspace(0.0, 1.0, count):
        friction = FRICTION + STD * random.normal(size=FRICTION.shape)
        friction[1, 1] += share * wear * FRICTION[1, 1]
        records.append(FrictionRecord(START + share * WEEK, friction, STD))
    return records


def test_only_the_worn_coefficient_changes_significantly() -> None:
    changes = FrictionTrend(NAMES, week_of_use(50, 0.1)).changes()
    assert [change.name for change in changes if change.is_clear] == ['Coulomb [Nm] of joint2']
    (worn,) = (change for change in changes if change.is_clear)
    assert worn.rate == pytest.approx(0.1 * FRICTION[1, 1], abs=3.0 * worn.rate_std)
    assert worn.rate_std == pytest.approx(STD[1, 1] / np.sqrt(50 / 12.0), rel=0.3)
    assert worn.new - worn.old == pytest.approx(worn.rate, rel=0.01)


def test_values_that_scatter_more_than_their_deviations_are_no_trend() -> None:
    random = np.random.default_rng(3)
    records = [
        record._replace(friction=record.friction * (1.0 + 0.3 * random.normal()))
        for record in week_of_use(30, 0.0)
    ]
    assert not any(change.is_clear for change in FrictionTrend(NAMES, records).changes())


def test_years_take_bounded_room_and_keep_their_ends() -> None:
    trend = FrictionTrend(NAMES)
    for day in range(3 * MOST):
        trend.add(FrictionRecord(START + 86400.0 * day, FRICTION, STD))
        assert len(trend.records) <= MOST
    times = [(record.time - START) / 86400.0 for record in trend.records]
    assert (times[0], times[-1]) == (0.0, 3 * MOST - 1)
    assert times == sorted(times)
    assert len(times) > MOST // 2


def test_one_record_is_no_trend() -> None:
    assert FrictionTrend(NAMES).changes() == []
    assert FrictionTrend(NAMES, week_of_use(1, 0.0)).changes() == []
