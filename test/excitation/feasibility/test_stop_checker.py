"""A stop begun anywhere is found where a dense search finds it."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.excitation.feasibility.stop_checker import StopChecker
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.player.excitation_player import ExcitationPlayer
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory.motion_sequence import MotionSequence, Stage
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.motion.joint_reference import JointReference

STOP_TIME = 0.5


class _Recorded:
    """A command law that notes what the player refers it to."""

    def __init__(self) -> None:
        self.references: list[JointReference] = []

    def command(self, reference: JointReference, position: np.ndarray) -> None:
        self.references.append(reference)


def test_the_peak_is_that_of_stops_as_they_are_played(
    setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    checker = StopChecker(setup.limits, setup.effort_model, STOP_TIME)
    motion = RampedExcitation(trajectory, 1, 2.0)
    margins = {(m.limit, m.subject): m for m in checker.margins(motion)}
    worst = margins['stop acceleration', 'joint2']
    names = setup.limits.joint_names
    peak = 0.0
    for begin in np.append(np.arange(0.0, motion.duration, 0.25), worst.time):
        law = _Recorded()
        player = ExcitationPlayer(
            MotionSequence([Stage('excitation', motion)]), law, names, 10.0, 100.0, STOP_TIME
        )
        first = round(begin * 1e9)
        player.update(0, motion.evaluate(0.0).q)
        player.stop()
        for stamp in first + (np.arange(0.0, STOP_TIME, 2e-3) * 1e9).astype(int):
            player.update(int(stamp), motion.evaluate(begin).q)
        peak = max(peak, *(abs(r.ddq[1]) for r in law.references[1:]))
    assert worst.reached == pytest.approx(peak, rel=0.01)


def test_a_harder_stop_binds(setup: ExcitationSetup, trajectory: FourierTrajectory) -> None:
    motion = RampedExcitation(trajectory, 1, 2.0)
    peaks = [
        max(
            m.reached
            for m in StopChecker(setup.limits, None, stop_time).margins(motion)
            if m.subject == 'joint2'
        )
        for stop_time in (2.0, 0.5, 0.1)
    ]
    assert peaks == sorted(peaks)
    hard = ExcitationSetup(
        setup.robot,
        replace(setup.config, stop_time=0.1),
        setup.limits,
        setup.rotor_inertia,
        setup.torque_per_ampere,
    )
    report = hard.checker.check_trajectory(trajectory, 2.0)
    assert not report.feasible
    assert report.binding.limit == 'stop acceleration'


def test_standing_still_there_is_nothing_to_brake(setup: ExcitationSetup) -> None:
    still = FourierTrajectory(0.1, np.array([0.0, 1.5, 0.0, 0.0]), *np.zeros((2, 4, 1)))
    margins = StopChecker(setup.limits, setup.effort_model, STOP_TIME).margins(
        RampedExcitation(still, 1, 2.0)
    )
    assert all(m.reached == 0.0 for m in margins if m.limit == 'stop acceleration')
    gravity = setup.effort_model.effort(still.q0[np.newaxis], *np.zeros((2, 1, 4)))[0]
    torque = {m.subject: m.reached for m in margins if m.limit == 'stop torque'}
    assert torque['joint2'] == pytest.approx(abs(gravity[1]))


@pytest.mark.parametrize('stop_time', [0.0, -1.0, float('nan')])
def test_the_stop_time_must_be_positive(setup: ExcitationSetup, stop_time: float) -> None:
    with pytest.raises(ExcitationError, match='stop time must be positive'):
        StopChecker(setup.limits, None, stop_time)
