"""An odometry that ends, jumps or is wrong while the tool is held, in the physics engine."""

from dataclasses import replace

import numpy as np
import pytest
from holding_flight import SETTLED, HeldFlight, HoldingFlight

from aerarm_ros.control.checks import RejectedInputError


@pytest.fixture(scope='module')
def flown() -> HoldingFlight:
    """Return a flight, which every test continues."""
    flight = HoldingFlight(HeldFlight(wind=0.5))
    flight.run(SETTLED)
    return flight


def test_without_odometry_the_tool_stops_in_the_base_frame_and_returns(
    flown: HoldingFlight,
) -> None:
    target = flown.source.goal
    assert target is not None
    # Targets that cannot be followed change nothing.
    for place, reason in (
        ([np.nan, 0.0, 0.0], 'finite'),
        ([0.0, 0.0, -3.0], 'out of reach'),
        ([0.0, 0.0, 1e6], 'check its unit'),
    ):
        with pytest.raises(RejectedInputError, match=reason):
            flown.source.go_to(place, flown.now)
    assert flown.source.goal is target
    flown.run(0.2)
    assert flown.source.reason == ''
    flown.tell = lambda sample: []
    flown.run(0.8)
    assert flown.law.is_stopped
    assert 'no usable odometry' in flown.source.reason
    at_rest = flown.plant.position
    flown.run(0.2)
    assert np.abs(flown.plant.position - at_rest).max() < 2e-3
    flown.tell = lambda sample: [sample]
    flown.run(3.0)
    assert flown.source.reason == ''
    assert flown.source.stops == 1
    assert np.linalg.norm(flown.tool() - target) < 5e-3


@pytest.mark.parametrize(
    ('shift', 'seconds', 'is_streamed', 'tolerance'),
    [(0.06, 2.5, False, 6e-3), (0.0, 1.0, True, 0.02)],
)
def test_the_tool_follows_a_jump_of_the_odometry_slowly(
    flown: HoldingFlight, shift: float, seconds: float, is_streamed: bool, tolerance: float
) -> None:
    """The second jump leads back; a stream of targets does not speed up the return."""
    jumps, target = flown.pose.jumps, flown.source.goal
    moved = np.array([0.0, shift, 0.0])
    flown.tell = lambda sample: [replace(sample, position=sample.position + moved)]
    places = [flown.tool()]
    for _ in range(round(seconds / 0.01)):
        if is_streamed:
            flown.source.go_to(target, flown.now)
        flown.run(0.01)
        places.append(flown.tool())
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.01
    assert speed.max() < 0.2
    assert flown.pose.jumps == jumps + 1
    assert np.linalg.norm(flown.tool() - (target - moved)) < tolerance
