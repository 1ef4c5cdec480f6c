"""Every limit is checked, reported with its margin, and named when it binds."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import EffortModel, FeasibilityChecker, StopLimits
from aerarm_ros.excitation.settings import InfeasibleError
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.motion.path_stop import stop_along

RAMP = 2.0


def test_reported_extremes_are_those_of_a_dense_grid(
    checker: FeasibilityChecker, trajectory: FourierTrajectory
) -> None:
    report = checker.check_trajectory(trajectory, RAMP)
    assert report.feasible
    motion = RampedExcitation(trajectory, 1, RAMP)
    reference = motion.evaluate(np.linspace(0.0, motion.duration, 50001))
    reached = {(m.limit, m.subject): m.reached for m in report.margins if m.limit != 'position'}
    for j, name in enumerate(checker.limits.joint_names):
        assert reached['velocity', name] == pytest.approx(
            np.abs(reference.dq[:, j]).max(), rel=1e-5
        )
        assert reached['acceleration', name] == pytest.approx(
            np.abs(reference.ddq[:, j]).max(), rel=1e-5
        )
        low, high = (
            m.reached for m in report.margins if (m.limit, m.subject) == ('position', name)
        )
        assert low == pytest.approx(reference.q[:, j].min(), abs=1e-6)
        assert high == pytest.approx(reference.q[:, j].max(), abs=1e-6)
    assert [m.limit for m in report.worst_of_each()] == [
        'frequency', 'position', 'velocity', 'acceleration', 'torque', 'motor current',
        'self clearance', 'ground clearance', 'holding torque', 'holding current',
    ]  # fmt: skip
    assert 'note: link1 to ground: not checked, because the distance is 0.035 m' in (
        report.as_table()
    )


@pytest.mark.parametrize(
    ('field', 'limit'),
    [
        ('position_max', 'position'),
        ('velocity', 'velocity'),
        ('acceleration', 'acceleration'),
        ('effort', 'torque'),
        ('current', 'motor current'),
    ],
)
def test_a_limit_just_below_the_reached_value_is_violated(
    checker: FeasibilityChecker, trajectory: FourierTrajectory, field: str, limit: str
) -> None:
    wide = checker.check_trajectory(trajectory, RAMP)
    extreme = max(
        (m for m in wide.margins if (m.limit, m.subject) == (limit, 'joint3')),
        key=lambda margin: margin.reached,
    )
    values = getattr(checker.limits, field).copy()
    values[2] = extreme.reached - 1e-3
    narrow = FeasibilityChecker(
        replace(checker.limits, **{field: values}), None, checker.effort_model
    )
    report = narrow.check_trajectory(trajectory, RAMP)
    assert not report.feasible
    with pytest.raises(InfeasibleError, match=f'the run is infeasible: {limit} of joint3'):
        report.require('the run')


def test_holding_the_arm_level_takes_its_weight_times_its_lever(
    robot: Robot, setup: ExcitationSetup
) -> None:
    rest = np.zeros((1, 4))
    effort = setup.effort_model.effort(rest, rest, rest)[0]
    pi = robot.inertial_parameters
    # First moments about joint 2 of links 2, 3 and 4, stretched along the base's x axis.
    moment = pi[1, 1] + (pi[2, 3] + 0.325 * pi[2, 0]) + (pi[3, 1] + 0.65 * pi[3, 0])
    assert effort[1] == pytest.approx(9.81 * moment, rel=1e-6)


def test_a_period_only_dissipates(
    robot: Robot, setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    time = np.arange(0.0, trajectory.period, 1e-3)
    reference = trajectory.evaluate(time)
    effort = setup.effort_model.effort(*reference)
    work = (effort * reference.dq).sum() * 1e-3
    friction = (robot.viscous * reference.dq**2 + robot.coulomb * np.abs(reference.dq)).sum() * 1e-3
    assert work == pytest.approx(friction, rel=1e-3)


def test_a_loaded_gear_needs_a_fraction_of_its_load_in_addition(robot: Robot) -> None:
    q, slow = np.zeros((2, 4)), np.array([1e-3, -1e-3])[:, np.newaxis] * np.ones(4)
    plain = EffortModel(robot).effort(q, slow, q)
    more = EffortModel(robot, load_friction=[0.0, 0.04, 0.0, 0.0]).effort(q, slow, q) - plain
    weight = EffortModel(robot).effort(q, q, q)[0, 1]
    np.testing.assert_allclose(more[:, 1], [0.04 * weight, -0.04 * weight], rtol=1e-3)
    assert (more[:, [0, 2, 3]] == 0.0).all()


def test_the_torque_of_the_rotors_does_not_load_the_gears(robot: Robot) -> None:
    q, dq, ddq = np.full((3, 1, 4), 0.3)
    light, heavy = (
        EffortModel(robot, rotors, load_friction=0.1).effort(q, dq, ddq)
        for rotors in (np.zeros(4), np.full(4, 2.0))
    )
    np.testing.assert_allclose(heavy - light, 2.0 * ddq)


def largest_shares(
    setup: ExcitationSetup, stops: StopLimits, motion: RampedExcitation
) -> tuple[float, float, float]:
    """Return the largest fractions of the acceleration, torque and current limits in stops."""
    limits, shares = stops.limits, np.zeros(3)
    for begin in np.arange(0.1, motion.duration, 0.4):
        clock = stop_along(motion.evaluate, begin, stops.rows).clock()
        at = clock.evaluate(np.linspace(0.0, clock.duration, 40))
        states = motion.evaluate(at.q[:, 0]).paced(at.dq, at.ddq)
        effort = setup.effort_model.effort(*states)
        current = setup.effort_model.current(effort)
        of_limits = states.ddq / limits.acceleration, effort / limits.effort
        used = (*of_limits, current / limits.current)
        shares = np.maximum(shares, [np.abs(share).max() for share in used])
    return tuple(shares.tolist())


def test_a_stop_begun_anywhere_keeps_acceleration_torque_and_current(
    setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    motion = RampedExcitation(trajectory, 1, 2.0)
    acceleration, torque, current = largest_shares(setup, setup.stops, motion)
    assert 0.9 < acceleration < 1.001
    assert max(torque, current) < 1.001
    # Where acceleration is hardly limited, torque or current limits the stop.
    loose = replace(setup.limits, acceleration=4.0 * setup.limits.acceleration)
    for index, weak in (
        (1, replace(loose, effort=0.6 * setup.limits.effort)),
        (2, replace(loose, current=0.6 * setup.limits.current)),
    ):
        assert largest_shares(setup, StopLimits(weak, None), motion)[index] > 1.5
        with_model = largest_shares(setup, StopLimits(weak, setup.effort_model), motion)
        assert 0.9 < with_model[index] < 1.001


def test_a_stop_ends_even_where_gravity_takes_more_than_the_limit(
    setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    weak = StopLimits(replace(setup.limits, effort=0.1 * setup.limits.effort), setup.effort_model)
    motion = RampedExcitation(trajectory, 1, 2.0)
    for begin in np.arange(2.0, motion.duration, 1.0):
        stop = stop_along(motion.evaluate, begin, weak.rows)
        assert stop.times[-1] < 3.0


def test_the_holding_torque_is_checked_at_every_possible_stop(setup: ExcitationSetup) -> None:
    still = FourierTrajectory(0.1, np.array([0.0, 1.0, 0.0, 0.0]), *np.zeros((2, 4, 1)))
    margins = setup.stops.margins(RampedExcitation(still, 1, 2.0))
    gravity = setup.effort_model.effort(still.q0[np.newaxis], *np.zeros((2, 1, 4)))[0]
    torque = {m.subject: m for m in margins if m.limit == 'holding torque'}
    assert torque['joint2'].reached == pytest.approx(abs(gravity[1]))
    assert torque['joint2'].allowed == setup.limits.effort[1]
    assert StopLimits(setup.limits, None).margins(RampedExcitation(still, 1, 2.0)) == []
