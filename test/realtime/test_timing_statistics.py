import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.realtime.periodic_loop import TimingStatistics, TimingSummary


@given(st.lists(st.integers(0, 30_000_000), min_size=1, max_size=300))
def test_agrees_with_numpy_to_one_bin(durations_ns: list[int]) -> None:
    statistics = TimingStatistics(resolution=10e-6, span=20e-3)
    for duration in durations_ns:
        statistics.add(duration)
    summary = statistics.summary()
    seconds = np.array(durations_ns) / 1e9
    assert summary.count == len(seconds)
    np.testing.assert_allclose(summary.mean, seconds.mean(), rtol=1e-9)
    np.testing.assert_allclose(summary.std, seconds.std(), rtol=1e-6, atol=1e-12)
    assert (summary.minimum, summary.maximum) == (seconds.min(), seconds.max())
    for share, found in ((0.5, summary.p50), (0.99, summary.p99), (0.999, summary.p999)):
        exact = np.quantile(seconds, share, method='inverted_cdf')
        if exact < 20e-3:
            assert exact <= found <= exact + 10e-6
        else:
            assert found == summary.maximum


def test_of_nothing_and_of_one() -> None:
    statistics = TimingStatistics()
    assert statistics.summary() == TimingSummary()
    statistics.add(5000)
    summary = statistics.summary()
    assert (summary.count, summary.minimum, summary.maximum, summary.std) == (1, 5e-6, 5e-6, 0.0)


def test_early_is_a_negative_duration() -> None:
    statistics = TimingStatistics()
    statistics.add(-2000)
    statistics.add(1000)
    assert statistics.summary().minimum == -2e-6


@pytest.mark.parametrize(('resolution', 'span'), [(0.0, 1.0), (1e-3, 1e-4), (1e-6, np.inf)])
def test_refuses_bins_that_make_no_sense(resolution: float, span: float) -> None:
    with pytest.raises(ValueError, match='resolution < span'):
        TimingStatistics(resolution, span)
