"""The data choose how the kinematics are cleaned."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.conditioning_options import ConditioningOptions
from aerarm_ros.identification.model_choice.filter_choice import choose_filter
from aerarm_ros.model.regressor import Regressor


def choice_for(recording, robot: Robot):
    conditioner = Conditioner([recording], ConditioningOptions())
    return choose_filter(Regressor(robot), conditioner, [recording])


@pytest.mark.parametrize(('lag', 'from_position'), [(0.0, False), (0.02, True)])
def test_velocities_that_lag_are_not_used(
    make_arm: Callable, robot: Robot, lag: float, from_position: bool
) -> None:
    """Boards filter velocity; positions are exact. Without lag, exact velocities are as good."""
    recording = make_arm(friction=0.0).recording(1)
    time = recording.time
    late = [np.interp(time - lag, time, column) for column in recording.dq.T]
    choice = choice_for(replace(recording, dq=np.column_stack(late)), robot)
    errors = {trial.kinematics.from_position: trial.error for trial in choice.trials}
    if from_position:
        assert choice.kinematics.from_position
        assert errors[True] < 0.2 * errors[False]
    assert min(errors.values()) == pytest.approx(0.0, abs=0.02)


def test_ripple_beyond_the_commanded_harmonics_is_kept(make_arm: Callable, robot: Robot) -> None:
    """A motion with content at the eighth harmonic is not that of five rectangular windows."""
    arm = make_arm(friction=0.0)
    t, q, dq, ddq = arm.motion(1)
    omega = 2 * np.pi * 0.8
    inside = (np.abs(t - 13.0) <= 10.0)[:, None]
    q = q + np.where(inside, 1e-3 * np.sin(omega * (t - 3.0))[:, None], 0.0)
    dq = dq + np.where(inside, 1e-3 * omega * np.cos(omega * (t - 3.0))[:, None], 0.0)
    ddq = ddq - np.where(inside, 1e-3 * omega**2 * np.sin(omega * (t - 3.0))[:, None], 0.0)
    plain = arm.recording(1)
    rows = np.searchsorted(t, plain.time - 1e-9)
    tau = arm.torque(q, dq, ddq)
    recording = replace(plain, q=q[rows], dq=dq[rows], tau=tau[rows])
    choice = choice_for(recording, robot)
    assert choice.kinematics.harmonics != 5
    assert choice.bags[0].samples.recorded == 10_000


def test_every_candidate_is_tried(make_arm: Callable, robot: Robot) -> None:
    recording = make_arm(rate=200.0).recording(1)
    assert len(choice_for(recording, robot).trials) == 6
    assert len(choice_for(replace(recording, dq=None), robot).trials) == 3


def test_of_a_long_recording_a_part_decides_and_all_is_used(
    make_arm: Callable, robot: Robot
) -> None:
    recording = make_arm(rate=100.0).recording(1, periods=14)
    choice = choice_for(recording, robot)
    assert len(choice.trials) == 6
    assert choice.bags[0].samples.recorded == 14_000


@pytest.mark.parametrize(('filter', 'counts'), [('harmonics', {5}), ('butterworth', {None})])
def test_the_filter_can_be_fixed(make_arm: Callable, robot: Robot, filter: str, counts) -> None:
    recording = make_arm(rate=200.0).recording(1)
    conditioner = Conditioner([recording], ConditioningOptions(filter=filter))
    choice = choose_filter(Regressor(robot), conditioner, [recording])
    assert {trial.kinematics.harmonics for trial in choice.trials} == counts
    assert len(choice.trials) == 2
