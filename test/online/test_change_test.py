import numpy as np

from aerarm_ros.online.payload_estimator import ChangeTest


def test_noise_finds_nothing() -> None:
    change = ChangeTest()
    squares = np.random.default_rng(0).normal(size=(20_000, 4)) ** 2
    assert not any(change.update(square) for square in squares.max(axis=1))


def test_a_lasting_error_is_found() -> None:
    change = ChangeTest()
    assert [change.update(9.0 * 3.0) for _ in range(3)] == [False, False, True]
    change.reset()
    assert not change.update(27.0)


def test_one_mad_sample_finds_nothing() -> None:
    change = ChangeTest()
    assert not change.update(1e12)
    assert not any(change.update(1.0) for _ in range(20))
    assert not change.update(1e12)
