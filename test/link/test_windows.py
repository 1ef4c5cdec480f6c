"""Windows of joint states."""

import numpy as np
import pytest

from aerarm_ros.ros.link.relayed_topics import pack_window, unpack_window


def test_a_peak_of_one_sample_survives() -> None:
    rng = np.random.default_rng(0)
    samples = list(rng.normal(size=(20, 12)))
    samples[7][3] = 40.0
    window = unpack_window(pack_window(123, samples))
    assert window.stamp_ns == 123
    np.testing.assert_allclose(window.newest, samples[-1], rtol=1e-6)
    rows = np.stack(samples)
    # Never inside the true extremes, and outside by the resolution of half precision.
    assert np.all(window.minimum <= rows.min(axis=0) + 1e-6)
    assert np.all(window.maximum >= rows.max(axis=0) - 1e-6)
    np.testing.assert_allclose(window.minimum, rows.min(axis=0), rtol=2e-3, atol=5e-3)
    np.testing.assert_allclose(window.maximum, rows.max(axis=0), rtol=2e-3, atol=5e-3)


def test_numbers_that_are_unknown_stay_unknown() -> None:
    window = unpack_window(pack_window(0, [np.array([np.nan, 1.0])] * 3))
    assert np.isnan(window.newest[0]) and np.isnan(window.minimum[0])
    assert window.maximum[1] == 1.0


@pytest.mark.parametrize('place', [0, 1, 2])
def test_one_unknown_sample_makes_the_extremes_of_its_window_unknown(place: int) -> None:
    samples = [np.array([5.0, 1.0]), np.array([2.0, 2.0]), np.array([3.0, 3.0])]
    known = pack_window(0, [sample.copy() for sample in samples])
    samples[place][0] = np.nan
    window = unpack_window(pack_window(0, samples))
    assert np.isnan([window.minimum[0], window.maximum[0]]).all()
    assert np.isnan(window.newest[0]) == (place == 2)
    assert (window.minimum[1], window.maximum[1]) == (1.0, 3.0)
    # The next window does not depend on this one.
    after = unpack_window(known)
    assert (after.minimum[0], after.maximum[0]) == (2.0, 5.0)


@pytest.mark.parametrize('content', [b'', b'12345', bytes(20)])
def test_invalid_window_bytes_raise_an_error(content: bytes) -> None:
    with pytest.raises(ValueError, match='window'):
        unpack_window(content + b'x')
