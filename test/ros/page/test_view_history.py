import numpy as np

from aerarm_ros.ros.page.view_plots import ViewHistory


def test_keeps_the_last_seconds_in_order() -> None:
    history = ViewHistory((3, 2), duration=1.0, rate=10.0)
    for k in range(35):
        history.add(0.1 * k, np.full((3, 2), float(k)))
    time, values = history.window(3.4)
    assert values.shape == (10, 3, 2)
    np.testing.assert_allclose(time, np.linspace(-0.9, 0.0, 10), atol=1e-9)
    np.testing.assert_allclose(values[:, 2, 1], np.arange(25, 35))


def test_old_samples_are_omitted() -> None:
    history = ViewHistory((3, 1), duration=1.0, rate=10.0)
    history.add(0.0, np.zeros((3, 1)))
    history.add(5.0, np.ones((3, 1)))
    time, values = history.window(5.5)
    np.testing.assert_allclose(time, [-0.5])
    np.testing.assert_allclose(values, 1.0)


def test_an_empty_history_is_empty() -> None:
    time, values = ViewHistory((3, 4), duration=10.0, rate=30.0).window(100.0)
    assert time.shape == (0,)
    assert values.shape == (0, 3, 4)
