import numpy as np
import pytest

from aerarm_ros.control.compensation import ErrorIntegral


def test_integrates() -> None:
    integral = ErrorIntegral([2.0, 0.0], [10.0, 10.0])
    for _ in range(1000):
        value = integral.update(np.array([0.5, 0.5]), 1e-3)
    np.testing.assert_allclose(value, [1.0, 0.0])


def test_does_not_wind_up() -> None:
    integral = ErrorIntegral([1.0], [0.2])
    for _ in range(1000):
        integral.update(np.array([5.0]), 1e-2)
    assert integral.update(np.array([-5.0]), 1e-2) == pytest.approx(0.15)


def test_a_negative_limit_is_refused() -> None:
    with pytest.raises(ValueError, match='limit'):
        ErrorIntegral([1.0], [-1.0])
