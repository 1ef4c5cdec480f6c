"""Stops along a path keep to it and to the limits, and are nearly as short as they can be."""

import numpy as np
import pytest

from aerarm_ros.motion.path_stop import JointBrake, acceleration_rows, brake, stop_along
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import JointReference

ACCELERATION = np.array([40.0, 15.0, 60.0])


def line(dq: np.ndarray, ddq: np.ndarray):
    """Return the motion from zero with a constant acceleration."""
    return lambda time: JointReference(
        time * dq + 0.5 * time**2 * ddq, dq + time * ddq, ddq * np.ones_like(dq)
    )


@pytest.fixture
def curve() -> PolynomialPath:
    """Return a curved path that uses 0.93 of the acceleration limits at most."""
    times = np.array([0.0, 0.5, 0.9, 1.5])
    q = np.array([[0.0, 0.0, 0.0], [0.8, 0.3, -0.6], [1.6, 0.1, 0.4], [1.0, 0.5, 0.0]])
    dq = np.array([[0.0, 0.0, 0.0], [2.5, 0.2, 0.5], [0.5, 0.2, 0.5], [0.0, 0.0, 0.0]])
    path = PolynomialPath.quintic(times, q, dq, np.zeros_like(q))
    scale = np.sqrt((np.abs(path.sample().ddq) / ACCELERATION).max() / 0.93)
    return PolynomialPath.quintic(scale * times, q, dq / scale, np.zeros_like(q))


@pytest.mark.parametrize('joint', range(3))
@pytest.mark.parametrize('speed', [0.8, 2.0, 5.0])
@pytest.mark.parametrize('rising', [0.0, 0.9, -0.5])
def test_a_stop_takes_at_most_half_as_much_again_as_the_least_distance(
    joint: int, speed: float, rising: float
) -> None:
    dq, ddq = np.zeros(3), np.zeros(3)
    dq[joint], ddq[joint] = -speed, -rising * ACCELERATION[joint]
    motion = line(dq, ddq)
    least = speed**2 / (2.0 * ACCELERATION[joint])
    along = stop_along(motion, 0.0, acceleration_rows(ACCELERATION)).path(motion)
    alone = brake(motion(0.0), ACCELERATION)
    for stop in (along, alone):
        end = stop.evaluate(stop.duration)
        assert least * 0.99 < abs(end.q[joint]) < 1.5 * least
        samples = stop.sample()
        assert np.all(np.abs(samples.ddq) <= 1.001 * ACCELERATION)
        np.testing.assert_allclose(samples.ddq[0], ddq, atol=1e-6)
        np.testing.assert_allclose(samples.dq[-1], 0.0, atol=1e-6)
        np.testing.assert_allclose(samples.ddq[-1], 0.0, atol=1e-3)


def test_a_stop_stays_on_a_curved_path_wherever_it_begins(curve: PolynomialPath) -> None:
    for begin in np.linspace(0.0, curve.duration, 25):
        stop = stop_along(curve.evaluate, begin, acceleration_rows(ACCELERATION))
        path = stop.path(curve.evaluate)
        times = np.linspace(0.0, path.duration, 300)
        samples, clock = path.evaluate(times), stop.clock().evaluate(times)
        rate = stop.clock().sample().dq[:, 0]
        assert rate[0] == pytest.approx(1.0)
        assert np.all(rate >= -1e-9), 'the clock never runs backward'
        assert np.all(np.diff(rate) <= 1e-9), 'nor faster'
        at = np.minimum(clock.q[:, 0], curve.duration)
        np.testing.assert_allclose(samples.q, curve.evaluate(at).q, atol=1e-5)
        assert np.all(np.abs(samples.ddq) <= 1.001 * ACCELERATION)
        # On the way to rest nothing is faster than the path is ahead of it.
        ahead = curve.evaluate(np.linspace(begin, stop.path_times[-1].value, 200))
        allowed = np.abs(ahead.dq).max(axis=0) + 1e-3
        assert np.all(np.abs(samples.dq) <= allowed)


def test_a_stop_is_found_where_the_least_one_is(curve: PolynomialPath) -> None:
    """The least stop: the lowest rate's derivative at each instant, integrated finely."""
    for begin in np.linspace(0.05, 0.8, 7) * curve.duration:
        value, rate, step = float(begin), 1.0, 1e-4
        while rate > 0.0 and value < curve.duration:
            _, dq, ddq = curve.evaluate(value)
            lowest = -(ACCELERATION + np.sign(dq) * ddq * rate**2) / np.maximum(np.abs(dq), 1e-9)
            value += step * rate
            rate += step * lowest.max()
        stop = stop_along(curve.evaluate, begin, acceleration_rows(ACCELERATION))
        # At slow places a stop takes 14 ms, whatever the limits would allow.
        assert stop.path_times[-1].value - begin < 1.5 * (value - begin) + 0.014


def test_many_brakings_at_once_are_each_its_own() -> None:
    random = np.random.default_rng(4)
    dq = random.uniform(-5.0, 5.0, (200, 3)) * random.choice([0.0, 0.01, 1.0], (200, 3))
    ddq = random.uniform(-1.0, 1.0, (200, 3)) * ACCELERATION
    together = JointBrake.of(dq, ddq, ACCELERATION)
    for row in range(200):
        path = brake(JointReference(np.zeros(3), dq[row], ddq[row]), ACCELERATION)
        samples = path.sample()
        np.testing.assert_allclose(samples.q[-1], together.travel[row], atol=1e-8)
        assert np.all(np.abs(samples.ddq) <= 1.001 * ACCELERATION)
        fastest = np.maximum(together.fastest[row], 0.02 * ACCELERATION)
        assert np.all(np.abs(samples.dq) <= fastest + 1e-6)
        start = path.evaluate(0.0)
        np.testing.assert_allclose(start.dq, dq[row], atol=1e-9)
        np.testing.assert_allclose(start.ddq, ddq[row], atol=1e-6)
