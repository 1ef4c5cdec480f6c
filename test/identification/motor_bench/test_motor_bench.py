"""The bench on emulated boards and a physics engine, against the parameters of that arm.

The plant's measured torque is the bridge's mean of a cycle, which leaves an error of a few mNm
per rad/s, and of K_d times 0.3 ms per rad/s^2: the tolerances below include them.
"""

from dataclasses import replace

import numpy as np
import pytest
from bench_rig import measure
from motor_data import GRAVITY, INERTIA, acceleration, steps, swings

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.bench_motion import BenchPlan
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedHeat
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_backlash import fit_backlash, is_significant
from aerarm_ros.identification.motor_bench.motor_bench import (
    Earlier,
    KnownMass,
    MotorBench,
    MotorResult,
    backlash_shifts,
    fit_inertia,
    fit_torque_constant,
)
from aerarm_ros.identification.motor_bench.motor_friction import (
    VOLTAGE,
    MotorFriction,
    MotorRun,
    MotorSupply,
    fit_motor_friction,
)
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.simulation.arm_plant import PlantParameters

# As short as each answer allows: an emulated second takes half of one.
PLAN = BenchPlan(speeds=(1.0, 2.0), span=1.2, runs=1)
LOADED_PLAN = BenchPlan(speeds=(1.0, 1.6), span=1.4, runs=1)  # joint 2 takes longer to get fast
GRAVITY_PLAN = BenchPlan(speeds=(1.2, 2.0), span=1.2, runs=0)
WORN = 0.015  # [rad] of play in each gear
WOUND = 0.19  # [ohm] of the motors that report voltages, not as configured


@pytest.fixture(scope='module')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='module')
def telling(config: ArmConfig) -> ArmConfig:
    """The same arm with boards that report voltages, its windings not as configured."""
    joints = [replace(j, motor=replace(j.motor, resistance=WOUND)) for j in config.joints]
    return replace(config, joints=tuple(joints), profile='laas_power')


@pytest.fixture(scope='module')
def robot(config: ArmConfig) -> Robot:
    return load_robot(joint_names=config.joint_names)


@pytest.fixture(scope='module')
def truth(config: ArmConfig, robot: Robot) -> PlantParameters:
    return PlantParameters.nominal(config, robot).perturbed(3)


def measured_per_true(truth: PlantParameters) -> np.ndarray:
    return truth.motor_torque_constant_nominal / truth.motor_torque_constant


def check_drive(result: MotorResult, truth: PlantParameters, joint: int) -> None:
    """Friction within 1 % and 0.001 Nms/rad, rotor inertia within 3 %."""
    true = measured_per_true(truth)[joint]
    assert result.coulomb[0] == pytest.approx(true * truth.coulomb[joint], rel=0.01)
    assert result.viscous[0] == pytest.approx(true * truth.viscous[joint], abs=1e-3)
    rotor = true * truth.rotor_inertia[joint] * result.ratio**2
    assert result.rotor_inertia is not None
    assert result.rotor_inertia[0] == pytest.approx(rotor, rel=0.03)
    assert result.rotor_inertia_known


def check_resistance(result: MotorResult, heat: EmulatedHeat, supply: MotorSupply) -> None:
    """As wound and warmed, weighted as least squares weights it; its deviation within 5 %."""
    true, steps = [], np.diff(supply.time, prepend=supply.time[0])
    for current, speed, duration in zip(supply.current, supply.speed, steps, strict=True):
        heat.step(current**2, speed, duration)
        true.append(heat.resistance)
    found = result.resistance
    assert found is not None
    assert found.source == VOLTAGE
    assert abs(found.ohm - np.average(true, weights=supply.current**2)) < 4.0 * found.std
    assert found.std < 0.05 * found.ohm


@pytest.fixture(scope='module')
def mounted(
    telling: ArmConfig, config: ArmConfig, robot: Robot, truth: PlantParameters
) -> tuple[list[MotorRun], MotorSupply]:
    """Runs of joint 4 without a mass."""
    return measure(telling, robot, truth, 3, config.rest_position, PLAN)


def test_a_mounted_joint_and_its_resistance_from_voltages(
    config: ArmConfig, telling: ArmConfig, robot: Robot, truth: PlantParameters, mounted: tuple
) -> None:
    bench = MotorBench(config, robot, config.rest_position)
    result = bench.evaluate(3, *mounted)
    check_drive(result, truth, 3)
    check_resistance(result, EmulatedHeat.of_joint(telling.joints[3], truth.seed), mounted[1])
    assert bench.warnings == []


def test_a_loaded_joint_and_a_rotor_behind_its_links(
    config: ArmConfig, robot: Robot, truth: PlantParameters
) -> None:
    """Joint 2 lifts the arm: 5 Nm of gravity, seventeen times the rotor's inertia in links."""
    runs, _ = measure(config, robot, truth, 1, config.rest_position, LOADED_PLAN)
    bench = MotorBench(config, robot, config.rest_position)
    result = bench.evaluate(1, runs)
    true = measured_per_true(truth)[1]
    assert result.coulomb[0] == pytest.approx(true * truth.coulomb[1], rel=0.15)
    assert result.friction.load == pytest.approx(truth.load_friction[1], abs=0.005)
    assert not result.rotor_inertia_known
    (warning,) = bench.warnings
    assert warning.startswith('joint2: rotor inertia and load inertia are not separable')


def test_swings_measure_the_backlash_of_a_worn_gear(
    config: ArmConfig, robot: Robot, truth: PlantParameters
) -> None:
    """Joint 2 is the whole arm's: the play of the others' gears does not matter."""
    worn, plan = replace(truth, backlash=np.full(4, WORN)), BenchPlan(swings=2)
    runs, _ = measure(config, robot, worn, 1, config.rest_position, plan, swings_only=True)
    links, rotor = 0.2398, config.joints[1].reflected_inertia  # as drawn
    gravity, nothing = np.array([0.0, 5.08]), np.zeros(0)  # as steps tell it of this arm
    friction = MotorFriction(0.0, 0.1, 0.02, gravity, np.zeros((5, 5)), nothing, nothing)
    found = fit_backlash(runs, friction, (links, 0.2 * links), (rotor, 0.3 * rotor), 'joint2')
    assert found[0] == pytest.approx(WORN, rel=0.1)
    assert is_significant(found)


def test_swings_without_a_significant_backlash_are_reported(
    config: ArmConfig, robot: Robot
) -> None:
    """Other joints may move within their backlash, and gravity may press the links to one flank."""
    runs = [*steps(), swings(0.02)]
    upright = MotorBench(config, robot, config.rest_position)
    vague = upright.evaluate(3, runs).backlash
    assert vague is not None
    assert vague[1] > 0.02
    assert upright.warnings[0].startswith('joint4: joint2 may move within their backlash')
    leaning = MotorBench(config, robot, [0.0, 1.0, 0.0, -0.5708])
    found = leaning.evaluate(3, runs).backlash
    assert found is not None
    assert not is_significant(found)
    (warning,) = leaning.warnings
    assert 'is not significant' in warning
    assert MotorBench(config, None, np.zeros(4)).evaluate(3, runs).backlash is None
    unheard = MotorRun(None, *np.zeros((4, 0)), swings=True)
    assert leaning.evaluate(3, [*steps(), unheard]).backlash is None
    assert leaning.warnings[-1].startswith(
        'backlash not measured: joint4: the oscillations are shorter'
    )


def test_torque_constant_from_a_known_mass(
    config: ArmConfig, robot: Robot, truth: PlantParameters, mounted: tuple
) -> None:
    mass, centre = 0.3, (0.1, 0.0, 0.0)
    loaded = truth.carrying(mass, centre, 0.03)
    runs, _ = measure(config, robot, loaded, 3, config.rest_position, GRAVITY_PLAN)
    alone = MotorBench(config, robot, config.rest_position).evaluate(3, mounted[0])
    earlier = Earlier({'joint4': alone.friction.gravity}, np.array(config.rest_position))
    bench = MotorBench(config, robot, config.rest_position, KnownMass(mass, centre), earlier)
    result = bench.evaluate(3, runs)
    assert bench.warnings == []
    assert result.torque_constant is not None
    # The stated constant is off by up to 2 %; what is left after the measurement, by a third.
    wanted = truth.motor_torque_constant[3]
    assert result.torque_constant[0] == pytest.approx(wanted, rel=6e-3)
    assert result.coulomb[0] == pytest.approx(truth.coulomb[3], rel=0.02)


def test_a_mass_without_a_lever_is_no_error(config: ArmConfig, robot: Robot) -> None:
    """Joint 1 is vertical: nothing that hangs on the arm turns it."""
    runs = steps(gravity=np.zeros(2), load=0.0)
    posture = np.array(config.rest_position)
    earlier = Earlier({'joint1': np.zeros(2)}, posture)
    bench = MotorBench(config, robot, posture, KnownMass(0.3, (0.1, 0.0, 0.0)), earlier)
    result = bench.evaluate(0, runs)
    assert result.torque_constant is None
    (warning,) = bench.warnings
    assert 'choose a posture with a longer lever arm' in warning


def test_impossible_uses_of_a_known_mass(config: ArmConfig, robot: Robot) -> None:
    posture = np.array(config.rest_position)
    for arm, earlier, words in (
        (robot, None, 'needs a run without it'),
        (robot, Earlier({}, posture + 0.1), 'choose the same posture'),
        (None, None, 'needs its lever'),
    ):
        with pytest.raises(IdentificationError, match=words):
            MotorBench(config, arm, posture, KnownMass(0.3), earlier)


def test_inertia_under_gravity_and_friction() -> None:
    friction = fit_motor_friction(steps(), mounted=True, name='j')
    inertia, std = fit_inertia([acceleration()], friction, 'j')
    assert inertia == pytest.approx(INERTIA, rel=0.02)
    assert 0.0 < std < 0.05 * INERTIA


def test_runs_that_tell_nothing_are_named() -> None:
    friction, run = fit_motor_friction(steps(), mounted=True, name='j'), acceleration()
    backwards = replace(run, tau=run.tau + 2.0 * INERTIA * np.pi**2 * run.q)  # ddq = -pi^2 q
    for runs, words in (([], 'acceleration runs are shorter'), ([backwards], 'measured inertia')):
        with pytest.raises(IdentificationError, match=f'elbow: the {words}'):
            fit_inertia(runs, friction, 'elbow')


MASS = np.array([0.3, 1.5])  # what it adds to a and b [Nm]


def friction_with(added: np.ndarray):
    runs = steps(noise=0.05, gravity=GRAVITY + added)
    return fit_motor_friction(runs, mounted=True, name='j')


def test_true_over_stated_constant() -> None:
    # A motor 4 % stronger than stated needs 4 % less current: the torque seems smaller.
    ratio, std = fit_torque_constant(friction_with(MASS / 1.04), GRAVITY, MASS, 'j')
    assert ratio == pytest.approx(1.04, abs=4.0 * std + 2e-3)
    assert 0.0 < std < 0.01
    # A bare motor needs no angle of the lever.
    friction = fit_motor_friction(steps(noise=0.05, gravity=MASS / 0.97), mounted=True, name='j')
    ratio, _ = fit_torque_constant(friction, None, float(np.linalg.norm(MASS)), 'j')
    assert ratio == pytest.approx(0.97, rel=5e-3)
    nothing = friction_with(np.zeros(2))
    for mass, words in ((0.0 * MASS, 'causes at most 0 Nm'), (MASS, 'adds .* expected 1.53 Nm')):
        with pytest.raises(IdentificationError, match=f'elbow: the known mass {words}'):
            fit_torque_constant(nothing, GRAVITY, mass, 'elbow')


DYNAMICS = Dynamics(load_robot())
UPRIGHT, LEANING, LEVEL = [0.0, 1.5708, 0.0, 0.0], [0.0, 1.0, 0.0, -0.5708], [0.0, 0.3, 0.0, 0.0]


@pytest.mark.parametrize(
    ('joint', 'posture', 'loose'),
    [
        # Joints 1 and 3 turn about one axis, and nothing presses joint 2 or 4.
        (0, UPRIGHT, [2]),
        (2, UPRIGHT, [0]),
        (3, UPRIGHT, [1]),
        # The whole arm is heavy: what rattles at its end does not move it.
        (1, UPRIGHT, []),
        (0, LEVEL, []),
        # Gravity presses joint 2, while link 4 stands on its head.
        (3, LEANING, []),
    ],
)
def test_a_joint_that_is_moved_and_not_pressed_moves_within_its_backlash(
    joint: int, posture: list, loose: list
) -> None:
    shift = backlash_shifts(DYNAMICS, np.array(posture), joint, 0.25, 20.0)
    assert np.flatnonzero(shift > 3e-3).tolist() == loose
    assert shift.max() < 0.06
