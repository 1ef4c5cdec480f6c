"""Stops of a player respect the limits from any start, and always end."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.motion.path_stop import stop_along


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
