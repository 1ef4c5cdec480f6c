"""Drafts of arms keep the URDF's values, mark estimated ones, and run."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated_arm import EmulatedArm

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain, load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.draft.arm_draft import ArmDraft
from aerarm_ros.draft.draft_text import arm_text, excitation_text
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.identify import IdentificationOptions
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.ros.library.identification import from_arrays, identify
from aerarm_ros.simulation.arm_plant import PlantParameters

EXAMPLES = ('three_joints', 'ur5')
# What is chosen by the data is tested elsewhere, and takes its time.
CONDITIONING = ConditioningOptions(cutoff=20.0)
FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


@pytest.fixture(scope='module')
def robots(example_urdf: Callable[[str], Path]) -> dict[str, Robot]:
    return {
        'three_joints': load_robot(resource('config', 'examples', 'three_joints.urdf')),
        'ur5': load_robot(example_urdf('ur5_robot.urdf')),
        'panda': load_robot(example_urdf('panda.urdf'), locked=FINGERS),
        'aerarm': load_robot(),
    }


@pytest.fixture(scope='module')
def drafts(robots: dict[str, Robot]) -> dict[str, ArmDraft]:
    return {name: ArmDraft(robot) for name, robot in robots.items()}


def shipped(name: str) -> ArmConfig:
    return load_arm_config(resource('config', 'examples', f'{name}.yaml'))


@pytest.mark.parametrize('name', EXAMPLES)
def test_the_packaged_examples_equal_the_present_draft(
    name: str, drafts: dict[str, ArmDraft]
) -> None:
    found, draft = shipped(name), drafts[name].config
    assert found.joint_names == draft.joint_names
    for field in ('effort_max', 'velocity_max', 'acceleration_max', 'board_kp', 'board_kd'):
        assert found.column(field) == pytest.approx(draft.column(field), rel=0.05), field
    assert found.rest_position == pytest.approx(draft.rest_position, abs=0.11)
    assert (found.boards, found.emulated_only) == (draft.boards, True)
    text = resource('config', 'examples', f'{name}_excitation.yaml')
    assert load_excitation_config(text).bias == pytest.approx(found.rest_position)


def test_limits_are_those_of_the_urdf_and_everything_else_is_marked(
    drafts: dict[str, ArmDraft], robots: dict[str, Robot], tmp_path: Path
) -> None:
    for name, draft in drafts.items():
        robot, config = robots[name], draft.config
        for field in ('position_min', 'position_max', 'velocity_max', 'effort_max'):
            known = np.isfinite(getattr(robot, field))
            assert np.array_equal(config.column(field)[known], getattr(robot, field)[known])
            marked = [field in guesses for guesses in draft.guesses]
            assert marked == list(~known)
        file = tmp_path / f'{name}.yaml'
        file.write_text(arm_text(draft, 'its.urdf'))
        assert load_arm_config(file) == config
        file.write_text(excitation_text(draft, 'its.urdf'))
        assert load_excitation_config(file) == draft.excitation


@pytest.mark.parametrize('name', ['three_joints', 'ur5', 'panda', 'aerarm'])
def test_the_drafted_loop_is_damped_in_every_posture(
    name: str, drafts: dict[str, ArmDraft], robots: dict[str, Robot]
) -> None:
    """The board's loop (4.5), linearized, with the velocity filter of 100 Hz."""
    config, robot = drafts[name].config, robots[name]
    drive, n = DriveTrain(config), config.n
    dynamics = Dynamics(robot, drive.reflected_inertia)
    stiffness = np.diag(drive.motor_to_joint_gain(config.column('board_kp')))
    damping = np.diag(drive.motor_to_joint_gain(config.column('board_kd')))
    cutoff, zero, one = 2.0 * math.pi * 100.0, np.zeros((n, n)), np.eye(n)
    low, high = config.column('position_min'), config.column('position_max')
    for q in np.random.default_rng(5).uniform(low, high, (50, n)):
        mobility = dynamics.mobility_matrix(q)
        system = np.block(
            [
                [zero, one, zero],
                [-mobility @ stiffness, zero, -mobility @ damping],
                [zero, cutoff * one, -cutoff * one],
            ]
        )
        poles = np.linalg.eigvals(system)
        assert np.all(poles.real < -2.0)
        assert np.all(-poles.real / np.abs(poles) > 0.4)


def test_the_drafted_home_configuration_is_free_of_collisions_and_easy_to_hold(
    drafts: dict[str, ArmDraft], robots: dict[str, Robot]
) -> None:
    for name, draft in drafts.items():
        config, robot = draft.config, robots[name]
        setup = ExcitationSetup.of_arm(robot, config, draft.excitation)
        setup.require_bias()
        load = Dynamics(robot).gravity(np.array(config.rest_position))
        assert np.all(np.abs(load) < 0.25 * config.column('effort_max')), name


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        (
            'type="revolute"',
            'type="prismatic"',
            ('joint shoulder is prismatic, but the drives are rotary'),
        ),
        (
            'effort="8"',
            'effort="1"',
            'the effort limit of 1 Nm is below the .* that hold the outstretched',
        ),
    ],
)
def test_arms_without_a_possible_draft_raise_errors(old: str, new: str, message: str) -> None:
    text = resource('config', 'examples', 'three_joints.urdf').read_text().replace(old, new, 1)
    with pytest.raises(ValueError, match=message):
        ArmDraft(load_robot(text))


def test_values_missing_in_the_urdf_are_guessed_and_marked() -> None:
    text = resource('config', 'examples', 'three_joints.urdf').read_text()
    bare = text.replace('<collision>', '<!--').replace('</collision>', '-->')
    draft = ArmDraft(load_robot(bare.replace('effort="8"', 'effort="0"')), 'bare')
    assert 'no moving link of the URDF has a <collision> shape' in draft.problem
    assert 'effort_max' in draft.guesses[1]
    load = Dynamics(load_robot(text)).gravity(np.array([0.0, math.pi / 2, 0.0]))[1]
    assert draft.config.joints[1].effort_max > 2.0 * abs(load)


def test_three_joints_are_identified_from_their_designed_motion(robots: dict[str, Robot]) -> None:
    """The whole process: drafted configuration, emulated boards, designed motion, model."""
    config, robot = shipped('three_joints'), robots['three_joints']
    folder = resource('config', 'examples')
    surroundings = load_excitation_config(folder / 'three_joints_excitation.yaml')
    file = TrajectoryFile.load(folder / 'three_joints_motion.yaml')
    truth = PlantParameters.nominal(config, robot).perturbed(7)
    arm = EmulatedArm(config, robot, truth, np.array(config.rest_position), seed=7)
    setup = ExcitationSetup.of_arm(robot, config, replace(surroundings, ramp_time=0.8))
    trajectory = file.for_joints(config.joint_names)
    motion = setup.planner.plan(trajectory, 1, arm.posture, go_back=False)
    states = [(s.stamp_ns * 1e-9, s.q, s.tau, s.dq) for s in arm.play(motion)]
    recorded = from_arrays(*map(np.array, zip(*states, strict=True)), config.joint_names)
    found = identify(
        recorded,
        robot,
        config=resource('config', 'examples', 'three_joints.yaml'),
        holdout=0.3,
        options=IdentificationOptions(CONDITIONING, friction='coulomb', tilt=False),
    )
    drawn, identified = (
        found.result.solutions[name].validation[0].filtered for name in ('cad', 'sdp')
    )
    assert identified < 3.0
    assert identified < 0.2 * drawn
    # Gravity's torque of the arm that was built, in a posture that it did not stop in.
    q = np.array([0.3, 0.7, -0.5])
    built = Dynamics(robot.with_inertial_parameters(truth.inertial_parameters)).gravity(q)
    assert Dynamics(found.robot).gravity(q) == pytest.approx(built, abs=0.03 * abs(built).max())
