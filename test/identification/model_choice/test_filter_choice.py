"""The data choose how the kinematics are cleaned."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.model_choice.filter_choice import choose_filter
from aerarm_ros.model.regressor import Regressor


def choice_for(recording, robot: Robot):
    conditioner = Conditioner([recording], ConditioningOptions())
    return choose_filter(Regressor(robot), conditioner, [recording])


@pytest.mark.parametrize('lag', [0.0, 0.02])
def test_velocities_that_lag_are_not_used_as_they_are(
    make_arm: Callable, robot: Robot, lag: float
) -> None:
    """Boards filter velocity; positions are exact. Without lag, exact velocities are as good."""
    recording = make_arm(friction=0.0).recording(1)
    time = recording.time
    late = [np.interp(time - lag, time, column) for column in recording.dq.T]
    choice = choice_for(replace(recording, dq=np.column_stack(late)), robot)
    by_rule = [trial for trial in choice.trials if trial.cutoff == pytest.approx(5.0)]
    as_measured = [not (t.kinematics.from_position or t.kinematics.in_time) for t in by_rule]
    errors = {lags: trial.error for lags, trial in zip(as_measured, by_rule, strict=True)}
    if lag:
        assert choice.kinematics.from_position or choice.kinematics.in_time
        assert choice.conditioner.delays.velocity == pytest.approx(lag, rel=0.01)
        assert errors[False] < 0.5 * errors[True]
    else:
        assert not any(trial.kinematics.in_time for trial in by_rule)
    # What a drawing that is off weighs against data of which it is said that they are noisy.
    assert min(errors.values()) < 0.5


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


def test_filters_then_sources_are_tried_at_the_rule_and_the_best_below_it(
    make_arm: Callable, robot: Robot
) -> None:
    recording = make_arm(rate=200.0).recording(1, noise=1.0)
    choice = choice_for(recording, robot)
    cutoffs = Counter(round(trial.cutoff, 6) for trial in choice.trials)
    assert cutoffs[5.0] == 4
    assert set(cutoffs) == {2.5, 3.5, 5.0}
    at_rule = [t.kinematics for t in choice.trials if t.cutoff == pytest.approx(5.0)]
    assert {kinematics.harmonics for kinematics in at_rule} == {5, 50, None}
    assert {kinematics.from_position for kinematics in at_rule} == {False, True}
    assert choice.conditioner.cutoff == pytest.approx(5.0)
    without = choice_for(replace(recording, dq=None), robot)
    assert all(trial.kinematics.from_position for trial in without.trials)


def test_of_a_long_recording_a_part_decides_and_all_is_used(
    make_arm: Callable, robot: Robot
) -> None:
    recording = make_arm(rate=100.0).recording(1, periods=14)
    assert choice_for(recording, robot).bags[0].samples.recorded == 14_000


def test_noise_that_misleads_the_rule_is_caught_by_held_out_torque(
    make_arm: Callable, robot: Robot
) -> None:
    """One joint's positions and velocities are noisy far above the motion, which ends at 0.5 Hz."""
    recording = make_arm(rate=250.0).recording(1, noise=0.5).part(0.15, 0.7, '')
    random = np.random.default_rng(0)
    noise = np.convolve(random.standard_normal(len(recording.q)), np.ones(6) / 6, 'same')
    q, dq = recording.q.copy(), recording.dq.copy()
    q[:, 2] += 9e-3 * noise
    dq[:, 2] += 0.9 * noise
    noisy = replace(recording, q=q, dq=dq)
    conditioner = Conditioner([noisy], ConditioningOptions())
    choice = choose_filter(Regressor(robot), conditioner, [noisy])
    assert conditioner.cutoff > 15.0
    assert choice.conditioner.cutoff < 7.0
    errors = {trial.cutoff: trial.error for trial in choice.trials}
    assert min(errors.values()) < 0.5 * max(errors.values())


@pytest.mark.parametrize(('filter', 'counts'), [('harmonics', {5}), ('butterworth', {None})])
def test_filter_and_cutoff_can_be_fixed(
    make_arm: Callable, robot: Robot, filter: str, counts
) -> None:
    recording = make_arm(rate=200.0).recording(1)
    conditioner = Conditioner([recording], ConditioningOptions(filter=filter, cutoff=6.0))
    choice = choose_filter(Regressor(robot), conditioner, [recording])
    assert {trial.kinematics.harmonics for trial in choice.trials} == counts
    assert [trial.cutoff for trial in choice.trials] == [6.0, 6.0]
