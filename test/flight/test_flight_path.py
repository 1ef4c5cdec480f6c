"""A continuous path through places and headings, rejected if no drone can follow."""

import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.flight.flight_state import FlightPath, FlightTarget

TIMES = [1.0, 2.0, 4.0]
PLACES = np.array([[0.0, 0.0, 1.0], [1.0, 0.5, 1.0], [2.0, -0.5, 2.0]])
HERE = FlightTarget(np.array([0.3, 0.0, 0.5]), 0.2)


def test_the_path_starts_at_the_drone_passes_the_points_and_ends_at_rest() -> None:
    path = FlightPath(TIMES, PLACES, [0.2, 3.0, -3.0], start=HERE)
    first = path.at(0.0)
    np.testing.assert_allclose(first.position, HERE.position)
    np.testing.assert_allclose(first.velocity, 0.0)
    for time, place in zip(TIMES, PLACES, strict=True):
        np.testing.assert_allclose(path.at(time).position, place, atol=1e-12)
    # It turns the short way, over pi.
    assert path.at(4.0).yaw == pytest.approx(2.0 * np.pi - 3.0)
    last = path.at(9.0)
    np.testing.assert_allclose(last.position, PLACES[-1])
    np.testing.assert_array_equal(last.velocity, 0.0)
    times = np.arange(0.0, 4.0, 1e-3)
    rows = [path.at(time) for time in times.tolist()]
    speeds = np.gradient([row.position for row in rows], 1e-3, axis=0)
    np.testing.assert_allclose(speeds[1:-1], [row.velocity for row in rows][1:-1], atol=1e-3)
    accelerations = np.gradient([row.velocity for row in rows], 1e-3, axis=0)
    given = [row.acceleration for row in rows]
    np.testing.assert_allclose(accelerations[1:-1], given[1:-1], atol=0.05)


def test_velocities_and_accelerations_that_are_given_are_met() -> None:
    speeds, forces = np.ones((3, 3)), np.full((3, 3), 0.5)
    path = FlightPath([0.0, 1.0, 2.0], PLACES, [0.0] * 3, speeds, forces)
    middle = path.at(1.0)
    np.testing.assert_allclose(middle.velocity, 1.0)
    np.testing.assert_allclose(middle.acceleration, 0.5)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'times': [0.0, 2.0, 1.0]}, 'must increase'),
        ({'times': [-1.0, 2.0, 4.0]}, 'must not be negative'),
        ({'times': [0.0, 0.1, 0.2]}, 'more time'),
        ({'times': []}, 'a time and a pose'),
        ({'positions': PLACES * np.nan}, 'finite'),
        ({'yaws': [0.0]}, 'a time and a pose'),
        ({'velocities': np.zeros((2, 3))}, 'or for none'),
    ],
)
def test_an_invalid_path_is_rejected(change: dict[str, object], reason: str) -> None:
    given = {'times': TIMES, 'positions': PLACES, 'yaws': [0.0] * 3, **change}
    with pytest.raises(RejectedInputError, match=reason):
        FlightPath(**given)
