"""Set force of the tool on a wall under a flying drone, in the physics engine."""

import numpy as np
import numpy.typing as npt
import pytest
from holding_flight import HeldFlight, HoldingFlight

from aerarm_ros.control.base.rotor_wrench import carrier_parameters
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.simulation.wall import Wall, WallParameters
from aerarm_ros.world.rotor_governor import RotorGovernor
from aerarm_ros.world.tool_force import Phase
from aerarm_ros.world.world_reference import WorldPath

Array = npt.NDArray[np.float64]
ALONG = np.array([1.0, 0.0, 0.0])


class PressingFlight(HoldingFlight):
    """A fully actuated drone in the wind whose tool presses on a wall."""

    def __init__(self, stiffness: float, yields_after: float = np.inf, gap: float = 0.02) -> None:
        super().__init__(HeldFlight(drone='drones/tilted_hexarotor.yaml'))
        point = tuple((self.tool() + gap * ALONG).tolist())
        self.wall = Wall(WallParameters(point, tuple(ALONG), stiffness, yields_after=yields_after))
        self.plant.build(self.wall, 'tool0')
        self.force = self.source.force
        self.pressed: list[tuple[float, float, float]] = []  # time, force, place along

    def _fly(self, now: float) -> None:
        if not self.source.base.problem(now):
            pose = self.source.base.pose(now)
            force = pose.rotation.T @ self.force.planned_on_tool(now)
            moment = np.cross(self.kinematics.position(self.plant.position), force)
            self._feed.offer_contact(now, np.concatenate([force, moment]))
        super()._fly(now)

    def _note(self) -> None:
        super()._note()
        self.pressed.append((self.now, -float(self.wall.force @ ALONG), float(self.tool()[0])))

    def press(self, seconds: float) -> Array:
        """Press with 5 N until the contact ends; return time, force and place along it (M, 3)."""
        self.source.push(5.0 * ALONG, self.now)
        end = self.now + seconds
        while self.now < end and self.force.is_active:
            self.run(0.05)
        return np.array(self.pressed)


@pytest.fixture(scope='module')
def far() -> PressingFlight:
    flight = PressingFlight(1e4, gap=10.0)
    with pytest.raises(RejectedInputError, match='not held in the world'):
        flight.source.push(5.0 * ALONG, 0.0)
    flight.run(1.5)
    return flight


@pytest.fixture
def flight(far: PressingFlight) -> PressingFlight:
    """Return a flight far from the wall, which several tests continue."""
    far.source.push([0.0, 0.0, 0.0], far.now)
    return far


@pytest.mark.parametrize('stiffness', [1e3, 1e4])
def test_a_force_is_held_and_the_tool_stops_after_the_wall_disappears(stiffness: float) -> None:
    flight = PressingFlight(stiffness, yields_after=2.5)
    flight.run(1.0)
    rows = flight.press(4.5)
    flight.run(0.4)
    after_touch = rows[:, 0] - rows[rows[:, 1] > 0.0][0, 0]
    held = rows[(after_touch > 1.5) & (after_touch < 2.49)]
    assert np.sqrt(((held[:, 1] - 5.0) ** 2).mean()) < 0.5
    assert rows[:, 1].max() < 8.0, 'the impact must not exceed the set force by much'
    assert flight.force.phase is Phase.NONE
    assert flight.force.reason.startswith('the wall gave way, or the tool left the wall')
    rows = np.array(flight.pressed)
    after = rows[len(after_touch) - np.sum(after_touch >= 2.5) :]
    assert (after[:, 2] - after[0, 2]).max() < 0.02


def test_the_tool_stops_at_an_object_that_is_softer_than_a_wall() -> None:
    flight = PressingFlight(60.0)
    flight.run(1.0)
    rows = flight.press(9.0)
    assert flight.force.reason.startswith('the wall gave way')
    assert rows[:, 1].max() < 5.0


def test_an_odometry_jump_in_the_approach_does_not_move_the_tool(flight: PressingFlight) -> None:
    flight.press(0.5)
    flight.force.shift(0.1 * ALONG)
    begun = flight.force._along
    flight.run(0.02)
    assert flight.force._along - begun < 0.005
    assert flight.force.phase is Phase.APPROACH


def test_a_force_beyond_the_rotors_is_rejected(flight: PressingFlight) -> None:
    whole = WholeBodyDynamics(flight.robot, carrier=carrier_parameters(flight.drone))
    flight.source.governor = RotorGovernor(whole, flight.drone, flight.drone.gravity_in_base)
    for force in (10.0, -7.7):
        with pytest.raises(RejectedInputError, match="of the rotors' range"):
            flight.source.push(force * ALONG, flight.now)
    flight.source.push(5.0 * ALONG, flight.now)
    assert flight.force.is_active
    flight.source.governor = None


def test_the_plan_has_no_motion_along_the_force(flight: PressingFlight) -> None:
    times = flight.now + np.array([0.0, 1.0, 2.0])
    places = flight.source.goal + np.outer([0.0, 0.01, 0.03], [1.0, 1.0, 0.0])
    flight.source.follow(WorldPath(times - flight.now, places), flight.now, flight.now)
    flight.source.push(5.0 * ALONG, flight.now)
    for free, planned in zip(
        [flight.source._goal.at(time) for time in times], flight.source.ahead(times), strict=True
    ):
        np.testing.assert_allclose([planned.dp[0], planned.ddp[0]], 0.0, atol=1e-12)
        np.testing.assert_allclose(planned.dp[1:], free.dp[1:])
        np.testing.assert_allclose(planned.ddp[1:], free.ddp[1:])
    assert abs(flight.source.ahead(times)[1].dp[1]) > 1e-3


def test_wrong_forces_are_rejected(flight: PressingFlight) -> None:
    for force, reason in (
        ([np.nan, 0.0, 0.0], 'finite'),
        ([30.0, 0.0, 0.0], 'force_max'),
        ([0.1, 0.0, 0.0], 'too small'),
    ):
        with pytest.raises(RejectedInputError, match=reason):
            flight.source.push(force, flight.now)
    far = flight.source._reach
    flight.source._reach = lambda places, q: 0.01
    with pytest.raises(RejectedInputError, match='out of reach'):
        flight.source.push(5.0 * ALONG, flight.now)
    flight.source._reach = far
    assert not flight.force.is_active
    flight.source.push(5.0 * ALONG, flight.now)
    with pytest.raises(RejectedInputError, match='direction'):
        flight.source.push([0.0, 5.0, 0.0], flight.now)
    flight.source.push([0.0, 0.0, 0.0], flight.now)
    assert not flight.force.is_active


def test_without_a_wall_the_approach_ends(flight: PressingFlight) -> None:
    flight.force.settings = flight.force.settings._replace(approach_max=0.03)
    flight.press(2.0)
    assert flight.force.reason.startswith('no wall within')
    assert flight.force.phase is Phase.NONE
