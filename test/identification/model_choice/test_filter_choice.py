"""The data choose filters, the direction of gravity and delays."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.files.summary import ReportExtras, summarise
from aerarm_ros.identification.filter_choice import choose_filter
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.model.dynamics import Dynamics
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
    by_rule = [k for k in choice.trials if k.cutoff == pytest.approx(5.0)]
    errors = {not (k.from_position or k.in_time): choice.trials[k] for k in by_rule}
    if lag:
        assert choice.kinematics.from_position or choice.kinematics.in_time
        assert choice.conditioner.delays.velocity == pytest.approx(lag, rel=0.01)
        assert errors[False] < 0.5 * errors[True]
    else:
        assert not any(k.in_time for k in by_rule)
    # What a drawing that is off weighs against data of which it is said that they are noisy.
    assert min(errors.values()) < 0.5


EFFORT = np.array([5e-3, 5e-3, -5e-3, 0.0])
VELOCITY = np.array([0.0, 8e-3, 0.0, 0.0])


def late(bag: Recording, values: np.ndarray, delay: np.ndarray) -> np.ndarray:
    pairs = zip(delay, values.T, strict=True)
    return np.column_stack([np.interp(bag.time - d, bag.time, v) for d, v in pairs])


def test_a_delay_of_five_milliseconds_is_found(arm) -> None:
    bag = arm.recording(1, noise=1.0)
    moved = replace(bag, tau=late(bag, bag.tau, EFFORT), dq=late(bag, bag.dq, VELOCITY))
    found = identified(moved)
    assert found.delay.found == pytest.approx(EFFORT, abs=1e-3)
    assert np.all((found.delay.deviation > 0.0) & (found.delay.deviation < 2e-3))
    assert np.all(np.abs(found.delay.found - EFFORT) < 3.0 * found.delay.deviation)
    assert found.conditioner.delays.velocity == pytest.approx(VELOCITY, abs=2e-4)
    assert found.delay.used[0] == pytest.approx(5e-3, abs=1e-3)
    assert np.array_equal(found.conditioner.delays.effort, found.delay.used)
    # What a summary holds are plain numbers.
    summary = json.loads(json.dumps(summarise(found, {}, ReportExtras())))
    assert summary['delays']['velocity_used'] is True
    undelayed, corrected = (
        each.recommended.identification[0].filtered for each in (identified(bag), found)
    )
    assert corrected < 1.1 * undelayed


def test_signals_of_one_instant_and_a_level_base_are_left_alone(result) -> None:
    assert np.abs(result.delay.found).max() < 1e-3
    assert not result.conditioner.delays.effort.any()
    assert not result.conditioner.delays.velocity.any()
    assert result.gravity.tilt == 0.0
    assert np.array_equal(result.robot.gravity_in_base, result.gravity.stated)
    assert result.gravity.error > 0.95


def test_a_tilt_is_found_and_used(make_arm: Callable, robot: Robot) -> None:
    level = robot.gravity_in_base
    true = level + np.cross([*np.radians([0.8, -1.1]), 0.0], level)
    leaning = replace(make_arm(rate=200.0), robot=robot.with_gravity(true))
    bags = [leaning.recording(seed, noise=1.0) for seed in (1, 2)]
    found, blind = identified(*bags), identified(*bags, tilt=False)
    gravity = found.gravity.used
    assert np.linalg.norm(np.cross(gravity, true)) < np.radians(0.2) * gravity @ gravity
    assert np.linalg.norm(gravity) == pytest.approx(np.linalg.norm(found.gravity.stated))
    assert np.array_equal(found.robot.gravity_in_base, gravity)
    assert blind.gravity.error is None
    assert found.recommended.validation[0].filtered < 0.8 * blind.recommended.validation[0].filtered
    # What slight tilts make of the rank is not the motion's merit.
    assert found.thesis_base.rank == blind.thesis_base.rank
    assert found.used_base.rank == blind.used_base.rank


POSTURE = np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.8])
# No period fits these harmonics, so that only a low-pass can be used.
HARMONICS = np.array([1.13, 2.29, 3.41, 4.17, 5.37])
FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


def panda_recording(panda: Robot, fundamental: float, seconds: float, seed: int) -> Recording:
    """Record an arm whose links differ from the drawing by up to 15 %."""
    random = np.random.default_rng(seed)
    alpha, beta = random.uniform(-0.35, 0.35, (2, 7, 5)) / np.sqrt(np.arange(1, 6))
    t = np.arange(0.0, seconds, 1e-3)
    omega = 2.0 * np.pi * fundamental * HARMONICS
    s, c = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = POSTURE + s @ alpha.T + c @ beta.T
    dq = (c * omega) @ alpha.T - (s * omega) @ beta.T
    ddq = -(s * omega**2) @ alpha.T - (c * omega**2) @ beta.T
    scale = 1.0 + 0.15 * np.random.default_rng(1).uniform(-1.0, 1.0, (7, 1))
    arm = panda.with_inertial_parameters(panda.inertial_parameters * scale)
    dynamics = Dynamics(arm, np.full(7, 0.2))
    links = np.array([dynamics.inverse(*state) for state in zip(q, dq, ddq, strict=True)])
    tau = links + 0.6 * dq + (0.3 + 0.02 * np.abs(links)) * np.tanh(dq / 0.02)
    noise, steps = np.zeros_like(dq), 0.03 * random.standard_normal(dq.shape)
    for k in range(1, len(noise)):
        noise[k] = 0.95 * noise[k - 1] + steps[k]
    return Recording(
        name=f'seed {seed}',
        joint_names=panda.joint_names,
        time=t,
        q=q + 1e-3 * random.standard_normal(q.shape),
        dq=np.round((dq + noise) / 0.01) * 0.01,
        tau=tau + 0.3 * random.standard_normal(tau.shape),
        dead_effort=np.zeros(7, dtype=bool),
    )


def test_the_chosen_cutoff_predicts_faster_motion(example_urdf: Callable[[str], Path]) -> None:
    """Noise of the velocities sets no band. Ten times a band of 65 Hz predicts 4 times worse."""
    panda = load_robot(example_urdf('panda.urdf'), locked=FINGERS)
    slow, fast = panda_recording(panda, 0.05, 20.0, 1), panda_recording(panda, 0.2, 6.0, 2)

    chosen, by_hand, high = (
        identified(
            slow,
            fast,
            robot=panda,
            conditioning=ConditioningOptions(cutoff=cutoff),
            friction='load',
        )
        for cutoff in (None, 3.0, 10.0)
    )
    errors = [r.recommended.validation[0] for r in (chosen, by_hand, high)]
    assert chosen.conditioner.band < 0.5
    assert errors[0].filtered < 1.1 * errors[1].filtered
    assert errors[0].raw < 1.1 * errors[1].raw
    assert errors[0].raw < 0.5 * errors[2].raw


def test_of_a_long_recording_a_part_decides_and_all_is_used(
    make_arm: Callable, robot: Robot
) -> None:
    recording = make_arm(rate=100.0).recording(1, periods=8)
    assert choice_for(recording, robot).bags[0].samples.recorded == 8_000
