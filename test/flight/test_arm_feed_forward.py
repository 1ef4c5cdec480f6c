"""The arm's forecast for the drone, evaluated by its stamps."""

import numpy as np
import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward, MassProperties

DRONE = load_drone_config()
LEAD, AHEAD = 0.03, 0.06
COM, INERTIA = np.array([0.1, -0.02, 0.2]), 0.05 * np.eye(3)
W = 2.0 * np.pi


def hanging() -> MassProperties:
    arm = MovingBaseDynamics(load_robot())
    return MassProperties.of(DRONE, *arm.composite_inertia(np.array([0.0, np.pi / 2, 0.0, 0.0])))


def wrench(time: float) -> np.ndarray:
    """Return a motion's wrench in the arm's base frame, which hangs upside down."""
    return np.array([np.sin(W * time), 0.5, 2.0, 0.1, 0.2 * np.cos(W * time), 0.0])


@pytest.fixture
def arm() -> ArmFeedForward:
    return ArmFeedForward(DRONE, hanging(), lead=LEAD)


def tell(arm: ArmFeedForward, begin: float, end: float) -> None:
    for time in np.arange(begin, end, 4e-3).tolist():
        arm.offer_motion(time, wrench(time))
        arm.offer_inertia(time, 1.5, COM, INERTIA)


def run(arm: ArmFeedForward, begin: float, end: float):
    for now in np.arange(begin, end, 4e-3).tolist():
        told = arm.at(now)
    return now, told


def test_a_forecast_that_ends_too_early_is_late(arm: ArmFeedForward) -> None:
    assert not arm.is_late(1.0)  # nobody tells anything
    tell(arm, 0.0, 1.0 + AHEAD)
    assert not arm.is_late(1.0)
    assert arm.is_late(1.02)  # derivatives reach beyond the lead
    arm.use_motion = False
    assert not arm.is_late(1.02)
    assert arm.is_late(1.0 + AHEAD)
    arm.use_posture = False
    assert not arm.is_late(2.0)


def test_the_feed_forward_is_that_of_the_time_at_which_a_command_acts(arm: ArmFeedForward) -> None:
    tell(arm, 0.0, 1.0 + AHEAD)
    now, told = run(arm, 0.0, 1.0)
    rotation, mount = DRONE.mount.rotation, np.array(DRONE.mount.position)
    for felt, time in ((told.wrench, now + LEAD), (told.wrench_now, now)):
        force = rotation @ wrench(time)[:3]
        np.testing.assert_allclose(felt[:3], force, atol=1e-3)
        moment = rotation @ wrench(time)[3:] + np.cross(mount, force)
        np.testing.assert_allclose(felt[3:], moment, atol=1e-3)
    np.testing.assert_allclose(told.force_rate[0], W * np.cos(W * now), rtol=0.01)
    np.testing.assert_allclose(
        told.force_curvature[0], -(W**2) * np.sin(W * (now + LEAD)), rtol=0.05
    )
    wanted = MassProperties.of(DRONE, 1.5, COM, INERTIA)
    np.testing.assert_allclose(told.body.centre, wanted.centre)
    np.testing.assert_allclose(told.body.inertia, wanted.inertia)
    assert told.body.mass == pytest.approx(4.5)


def test_each_part_is_switched_by_itself(arm: ArmFeedForward) -> None:
    tell(arm, 0.0, 1.0 + AHEAD)
    arm.use_motion = False
    _, told = run(arm, 0.0, 0.5)
    assert not np.any(told.wrench)
    assert told.body.centre[0] > 0.01
    arm.use_motion, arm.use_posture = True, False
    _, told = run(arm, 0.5, 1.0)
    assert np.any(told.wrench)
    np.testing.assert_array_equal(told.body.centre, hanging().centre)
    arm.lead = 0.0
    told = arm.at(1.0)
    np.testing.assert_allclose(told.wrench, told.wrench_now)


def test_silence_lets_the_motion_fade_and_keeps_the_posture(arm: ArmFeedForward) -> None:
    tell(arm, 0.0, 0.5 + AHEAD)
    run(arm, 0.0, 0.5)
    sizes = [np.linalg.norm(arm.at(now).wrench) for now in np.arange(0.5, 1.0, 4e-3).tolist()]
    assert sizes[0] > 1.0
    assert sizes[-1] == 0.0
    assert np.abs(np.diff(sizes)).max() < 0.2  # no step
    assert arm.at(1.0).body.mass == pytest.approx(4.5)
    # A clock that is set back begins anew.
    tell(arm, -9.0, -8.0 + AHEAD)
    _, told = run(arm, -9.0, -8.0)
    assert np.linalg.norm(told.wrench) > 1.0


def test_with_a_late_forecast_the_last_one_is_used(arm: ArmFeedForward) -> None:
    tell(arm, 0.0, 1.0)
    now, told = run(arm, 0.0, 1.0)
    np.testing.assert_allclose(told.wrench, told.wrench_now, atol=0.05)
    assert np.linalg.norm(told.wrench) > 1.0
    # What turns a drone must be known beyond doubt.
    np.testing.assert_array_equal(told.force_rate, 0.0)
    np.testing.assert_array_equal(told.force_curvature, 0.0)


def test_a_planned_contact_acts_at_once_and_fades_in_silence(arm: ArmFeedForward) -> None:
    force = np.array([5.0, 0.0, 0.0])
    before = arm.at(0.0).wrench
    arm.offer_contact(0.004, np.r_[force, 0.0, 0.0, 0.0])
    pressed = arm.at(0.004).wrench - before
    turned = DRONE.mount.rotation @ force
    np.testing.assert_allclose(pressed[:3], turned, atol=1e-9)
    np.testing.assert_allclose(pressed[3:], np.cross(DRONE.mount.position, turned), atol=1e-9)
    sizes = [
        float(np.linalg.norm((arm.at(time).wrench - before)[:3]))
        for time in np.arange(0.008, 0.4, 0.004)
    ]
    assert sizes[-1] == 0.0
    assert np.all(np.diff(sizes) <= 1e-12)
    assert max(np.abs(np.diff(sizes))) < 0.5  # [N], no step


def test_nonsense_is_refused(arm: ArmFeedForward) -> None:
    for mass in (np.nan, 0.0, 50.0):
        with pytest.raises(RejectedInputError, match='arm_inertia'):
            arm.offer_inertia(0.0, mass, COM, INERTIA)
    for com, inertia in ((1e3 * COM, INERTIA), (COM, INERTIA - 0.06 * np.diag([0.0, 0.0, 1.0]))):
        with pytest.raises(RejectedInputError, match='arm_inertia: the centre'):
            arm.offer_inertia(0.0, 1.5, com, inertia)
    for force, moment in ((np.nan, 0.0), (1e4, 0.0), (0.0, 1e4)):
        with pytest.raises(RejectedInputError, match='base_wrench_motion'):
            arm.offer_motion(0.0, np.repeat([force, moment], 3))
    for force in (np.nan, np.inf, 30.0):  # beyond the weight of the drone
        with pytest.raises(RejectedInputError, match='planned_contact'):
            arm.offer_contact(0.0, np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0]))
    told = arm.at(0.004)
    assert not np.any(told.wrench)
    np.testing.assert_array_equal(told.body.inertia, hanging().inertia)
