"""Motions slowed along their path so that rotors stay within their limits."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from aerarm_ros.control.base.rotor_wrench import carrier_parameters
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.world.heading import HeadingControl
from aerarm_ros.world.rotor_governor import ReactionLimit, RotorGovernor

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
OUT = HANGING + np.array([1.2, -1.2, 0.8, -1.0])


LIMIT = np.radians(5.0)
BESIDE, TURNED = HANGING - [0.0, 0.6, 0.0, 0.0], HANGING + [1.5, -0.6, 0.0, 0.0]


def governor_of(
    drone: DroneConfig,
    share: float = 0.7,
    heading: HeadingControl | None = None,
    unknown: float = 0.0,
) -> RotorGovernor:
    robot = load_robot(gravity_in_base=drone.gravity_in_base)
    rotors = load_arm_config().column('reflected_inertia')
    whole = WholeBodyDynamics(robot, rotors, carrier_parameters(drone))
    return RotorGovernor(whole, drone, drone.gravity_in_base, share, heading, unknown)


@pytest.fixture(params=['drone.yaml', 'drones/tilted_hexarotor.yaml'])
def drone(request: pytest.FixtureRequest) -> DroneConfig:
    return load_drone_config(resource('config', request.param))


def thrusts(governor: RotorGovernor, motion: JointReference) -> list[np.ndarray]:
    """Return the thrusts for r', r^2 and hovering at a point of a motion."""
    com = governor.whole.composite_inertia(motion.q)[1]
    return [governor._mixer @ governor._given(w, com) for w in governor._wrenches(motion)]


def usage(governor: RotorGovernor, motion: JointReference) -> float:
    """Return the largest use of a rotor's range: 0 in its middle, 1 at its limits."""
    _, across, still = thrusts(governor, motion)
    return float((np.abs(across + still - governor._middle) / governor._half).max())


def usages(governor: RotorGovernor, motion: PolynomialPath) -> np.ndarray:
    times = np.linspace(0.0, motion.duration, 400)
    return np.array([usage(governor, motion.evaluate(float(time))) for time in times])


def test_a_hovering_drone_lifts_its_weight(drone: DroneConfig) -> None:
    governor = governor_of(drone)
    along, across, still = thrusts(governor, JointReference.at_rest(HANGING))
    lift = drone.allocation @ still
    assert lift[2] == pytest.approx(governor.whole.mass * 9.81, rel=1e-6)
    assert lift[:2] == pytest.approx(np.zeros(2), abs=1e-6)
    assert along == pytest.approx(0.0, abs=1e-9)
    assert across == pytest.approx(0.0, abs=1e-9)


def test_the_reaction_agrees_with_momentum(drone: DroneConfig) -> None:
    """The moment about the centre of mass is the rate of the angular momentum there."""
    governor, h = governor_of(drone), 1e-4
    motion = PolynomialPath.rest_to_rest(HANGING, OUT, 1.0)
    here = motion.evaluate(0.3)
    _, across, _ = thrusts(governor, here)
    _, com, _ = governor.whole.composite_inertia(here.q)

    def momentum(time: float) -> np.ndarray:
        point = motion.evaluate(time)
        return governor.whole.centroidal_momentum(point.q, point.dq, np.zeros(6))

    rate = (momentum(0.3 + h) - momentum(0.3 - h)) / (2.0 * h)
    mount = drone.mount
    wrench = drone.allocation @ across
    about = wrench[3:] - np.cross(mount.position + mount.rotation @ com, wrench[:3])
    assert about == pytest.approx(mount.rotation @ rate[3:], abs=2e-3)


def test_a_fast_motion_is_slowed_along_its_path(drone: DroneConfig) -> None:
    governor = governor_of(drone)
    motion = PolynomialPath.rest_to_rest(HANGING, OUT, 0.45)
    assert usages(governor, motion).max() > 0.8
    slowed = governor.govern(motion)
    assert isinstance(slowed, PolynomialPath)
    assert usages(governor, slowed).max() < 0.72
    assert governor.last_stretch == pytest.approx(slowed.duration / motion.duration)
    assert usages(governor, slowed).max() > 0.6, 'it is not slower than it need be'
    # The path is the same one: each posture on it is one of the motion's.
    way = np.array([motion.evaluate(float(t)).q for t in np.linspace(0.0, 0.45, 2000)])
    for time in np.linspace(0.0, slowed.duration, 50):
        away = np.abs(way - slowed.evaluate(float(time)).q).max(axis=1).min()
        assert away < 2e-3
    end = slowed.evaluate(slowed.duration)
    assert end.q == pytest.approx(OUT, abs=1e-9)
    assert end.dq == pytest.approx(0.0, abs=1e-9)


def test_a_posture_that_the_drone_cannot_hover_under_is_rejected() -> None:
    drone = load_drone_config()
    weak = replace(drone, rotors=tuple(replace(rotor, thrust_max=8.2) for rotor in drone.rotors))
    governor = governor_of(weak, 0.5)
    with pytest.raises(RejectedInputError, match='could not hover'):
        governor.govern(PolynomialPath.rest_to_rest(HANGING, OUT, 2.0))


def test_a_motion_about_the_vertical_is_slowed_until_the_heading_stays(drone: DroneConfig) -> None:
    """Without the heading's limit, the rotors of both drones can give the moment."""
    motion = PolynomialPath.rest_to_rest(BESIDE, TURNED, 2.0)
    assert governor_of(drone).govern(motion) is motion
    governor = governor_of(drone, heading=HeadingControl(LIMIT))
    slowed = governor.govern(motion)
    assert governor.last_stretch > 1.2
    assert slowed.duration == pytest.approx(governor.last_stretch * 2.0)
    assert governor.govern(slowed) is slowed, 'the slowed motion respects the limits'
    fed = governor_of(drone, heading=HeadingControl(LIMIT, is_fed=True))
    assert fed.govern(motion) is motion


def test_an_excitation_gets_one_factor(drone: DroneConfig) -> None:
    motion = PolynomialPath.rest_to_rest(HANGING, OUT, 0.6)
    governor = governor_of(drone, heading=HeadingControl(LIMIT))
    factor = governor.slowdown(motion)
    assert factor > 1.2
    slower = PolynomialPath.rest_to_rest(HANGING, OUT, 0.6 * factor)
    assert governor.slowdown(slower) == pytest.approx(1.0, abs=0.02)
    assert governor.slowdown(PolynomialPath.rest_to_rest(HANGING, OUT, 20.0)) == 1.0


def test_a_drone_with_rotors_in_one_plane_needs_thrust_to_tilt() -> None:
    """Quick motion across the drone: the tilt alone takes the rotors beyond their share."""
    drone = load_drone_config()
    governor = governor_of(drone)
    swing = PolynomialPath.rest_to_rest(HANGING, HANGING + [0.0, 0.5, 0.0, 0.0], 0.5)
    assert usages(governor, swing).max() < 0.7
    assert governor.govern(swing).duration > 0.55


def test_an_acceleration_is_shortened_to_the_rotors(drone: DroneConfig) -> None:
    governor = governor_of(drone)
    dq = np.array([0.3, -0.2, 0.5, 0.4])
    gentle, hard = np.array([0.2, 0.3, -0.4, 0.5]), np.array([40.0, -15.0, 30.0, 30.0])
    np.testing.assert_array_equal(governor.limited(HANGING, dq, gentle), gentle)
    posture = HANGING - [0.0, 0.4, 0.0, -1.0]
    limited = governor.limited(posture, dq, hard)
    assert usage(governor, JointReference(posture, dq, hard)) > 0.8
    assert usage(governor, JointReference(posture, dq, limited)) == pytest.approx(0.7, abs=1e-6)
    np.testing.assert_allclose(limited / limited[0], hard / hard[0])


def test_no_signs_of_accelerations_within_the_limits_exceed_the_share(drone: DroneConfig) -> None:
    governor, most = governor_of(drone), np.array([40.0, 15.0, 60.0, 60.0])
    dq = np.array([0.3, -0.2, 0.5, 0.4])
    posture = HANGING - [0.0, 0.4, 0.0, -1.0]
    limit = governor.motion_limits(posture, dq, most).acceleration_max
    assert (limit <= most).all()
    assert limit.min() > 0.5
    for signs in product((-1.0, 1.0), repeat=4):
        assert usage(governor, JointReference(posture, dq, np.array(signs) * limit)) < 0.7 + 1e-6


def test_turning_is_the_rotation_of_a_free_drone(drone: DroneConfig) -> None:
    governor = governor_of(drone, heading=HeadingControl(LIMIT))
    dq = np.array([0.3, -0.2, 0.5, 0.4])
    limit = governor.motion_limits(BESIDE, dq, np.full(4, 20.0))
    momentum = governor.whole.centroidal_momentum(BESIDE, dq, np.zeros(6))[3:]
    inertia = governor.whole.composite_inertia(BESIDE)[2]
    up = -drone.gravity_in_base / 9.81
    assert limit.turning @ dq == pytest.approx(up @ momentum / (up @ inertia @ up), rel=1e-6)
    assert limit.turn_max == HeadingControl(LIMIT).turn_max


def test_an_arm_that_may_carry_an_unknown_payload_moves_slower() -> None:
    drone, motion = load_drone_config(), PolynomialPath.rest_to_rest(BESIDE, TURNED, 1.0)
    durations = [
        governor_of(drone, heading=HeadingControl(LIMIT), unknown=mass).govern(motion).duration
        for mass in (0.0, 0.2)
    ]
    assert durations[1] > 1.05 * durations[0], durations
    heading = HeadingControl(LIMIT)
    factors = [governor_of(drone, 0.7, heading, mass).slowdown(motion) for mass in (0.0, 0.2)]
    assert factors[1] > 1.05 * factors[0], factors


def test_a_reaction_is_limited_only_if_it_lasts(drone: DroneConfig) -> None:
    governor = governor_of(drone)
    reaction = ReactionLimit(governor)
    posture, rest = HANGING - [0.0, 0.4, 0.0, -1.0], np.zeros(4)
    hard = np.array([40.0, -15.0, 30.0, 30.0])
    for cycle in range(200):
        swing = hard * np.sin(2.0 * np.pi * 25.0 * 1e-3 * cycle)
        np.testing.assert_allclose(reaction(posture, rest, swing, 1e-3), swing, atol=1e-9)
    for _ in range(1000):
        lasting = reaction(posture, rest, hard, 1e-3)
    assert usage(governor, JointReference(posture, rest, hard)) > 0.8
    assert usage(governor, JointReference(posture, rest, lasting)) == pytest.approx(0.7, abs=1e-3)


def test_a_heading_that_no_pace_holds_is_rejected() -> None:
    tight = HeadingControl(1e-6, frequency=0.1)
    motion = PolynomialPath.rest_to_rest(BESIDE, TURNED, 1.0)
    with pytest.raises(RejectedInputError, match='heading'):
        governor_of(load_drone_config(), heading=tight).slowdown(motion)
