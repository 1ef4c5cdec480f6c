import numpy as np
import pytest
from derivatives import assert_derivatives_agree

from aerarm_ros.planner.spline_basis import SplineBasis

START, END, DURATION = np.array([0.5, -1.0]), np.array([1.5, 2.0]), 1.7


@pytest.fixture
def basis() -> SplineBasis:
    return SplineBasis.of(6, 40)


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(5).uniform(-2.0, 2.0, (6, 2))


def test_the_path_is_the_spline_that_was_evaluated(basis, points) -> None:
    path = basis.path(points, START, END, DURATION)
    middles = (np.arange(40) + 0.5) * DURATION / 40
    for mine, paths in zip(
        basis.motion(points, START, END, DURATION), path.evaluate(middles), strict=True
    ):
        np.testing.assert_allclose(mine, paths, atol=1e-9)


def test_splines_begin_and_end_at_rest_within_their_control_points(basis, points) -> None:
    path = basis.path(points, START, END, DURATION)
    times = np.linspace(-0.1, DURATION + 0.1, 20001)
    assert_derivatives_agree(times, path.evaluate(times), 1e-3, 1e-1)
    first, last = path.evaluate(0.0), path.evaluate(DURATION - 1e-12)
    np.testing.assert_allclose(first.q, START)
    np.testing.assert_allclose(last.q, END)
    np.testing.assert_allclose(np.concatenate([*first[1:], *last[1:]]), 0.0, atol=1e-7)
    q, everything = path.evaluate(times).q, np.vstack([points, START, END])
    assert np.all(q >= everything.min(axis=0) - 1e-12)
    assert np.all(q <= everything.max(axis=0) + 1e-12)
