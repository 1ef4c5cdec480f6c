from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, PlantError, PlantParameters

CONFIG = load_arm_config()
ROBOT = load_robot()
NOMINAL = PlantParameters.nominal(CONFIG, ROBOT)
UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])
STRETCHED = np.zeros(4)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize('gravity', [(0, 0, -9.81), (0, 0, 9.81), (3.0, -2.0, -9.0)])
@pytest.mark.parametrize('seed', [None, 3])
def test_agrees_with_the_controllers_model_without_friction(rng, gravity, seed):
    robot = load_robot(gravity_in_base=gravity)
    parameters = NOMINAL.without_friction()
    if seed is not None:
        parameters = parameters.perturbed(seed)
    plant = ArmPlant(robot, parameters)
    known = robot.with_inertial_parameters(parameters.inertial_parameters)
    model = Dynamics(known, parameters.rotor_inertia)
    for _ in range(20):
        q, dq = rng.uniform(-0.5, 0.5, 4) + UPRIGHT, rng.uniform(-3, 3, 4)
        tau = rng.uniform(-5, 5, 4)
        plant.reset(q, dq)
        plant.apply_effort(tau)
        plant.step()
        # The torques that the model says the motion took are those that were applied.
        assert model.inverse(q, dq, plant.acceleration) == pytest.approx(tau, abs=1e-9)


def test_a_payload_grasped_in_motion_acts_from_then_on(rng):
    parameters = NOMINAL.without_friction().perturbed(3)
    loaded = parameters.carrying(0.2, (0.1, 0.01, -0.02), 0.03)
    plant = ArmPlant(ROBOT, parameters)
    q, dq, tau = UPRIGHT + 0.3, rng.uniform(-2, 2, 4), rng.uniform(-5, 5, 4)
    plant.reset(q, dq)
    plant.grasp(loaded)
    assert (plant.position == q).all() and (plant.velocity == dq).all()
    assert plant.parameters.inertial_parameters == pytest.approx(loaded.inertial_parameters)
    plant.apply_effort(tau)
    plant.step()
    model = Dynamics(
        ROBOT.with_inertial_parameters(loaded.inertial_parameters), parameters.rotor_inertia
    )
    assert model.inverse(q, dq, plant.acceleration) == pytest.approx(tau, abs=1e-9)


def test_friction_at_speed_is_viscous_plus_coulomb_plus_load_share(rng):
    parameters = NOMINAL.perturbed(3)
    plant = ArmPlant(ROBOT, parameters)
    model = Dynamics(
        ROBOT.with_inertial_parameters(parameters.inertial_parameters), parameters.rotor_inertia
    )
    for _ in range(10):
        q, dq = rng.uniform(-0.5, 0.5, 4) + UPRIGHT, rng.choice([-2.0, 2.0], 4)
        plant.reset(q, dq)
        plant.advance(5 * SUBSTEP)  # the load share follows the load with one sub-step of delay
        q, dq, load = plant.position, plant.velocity, plant.transmitted_effort
        plant.step()
        lost = -model.inverse(q, dq, plant.acceleration)
        dry = parameters.coulomb + parameters.load_friction * np.abs(load)
        assert lost == pytest.approx(parameters.viscous * dq + dry * np.sign(dq), abs=0.02)


def test_without_friction_energy_is_kept(rng):
    plant = ArmPlant(ROBOT, NOMINAL.without_friction(), UPRIGHT + 0.1)
    plant.gravity_in_base = (0.0, 0.0, -2.0)
    start = plant.energy
    kinetic = []
    for _ in range(20):
        plant.advance(0.02)
        assert plant.energy == pytest.approx(start, abs=2e-3)
        kinetic.append(np.abs(plant.velocity).max())
    assert max(kinetic) > 0.1


@pytest.mark.parametrize('seed', range(3))
def test_with_friction_and_no_effort_energy_only_falls(seed, rng):
    plant = ArmPlant(ROBOT, NOMINAL.perturbed(seed), UPRIGHT)
    plant.reset(UPRIGHT, rng.uniform(-2, 2, 4))
    start = energy = plant.energy
    for _ in range(110):  # then a stop is reached, whose spring holds energy too
        plant.advance(0.005)
        assert plant.energy <= energy + 1e-6
        energy = plant.energy
    assert energy < start - 0.1


def test_a_joint_rests_while_its_load_is_below_its_friction():
    plant = ArmPlant(ROBOT, NOMINAL, STRETCHED)
    weight = Dynamics(ROBOT).gravity(STRETCHED)
    plant.apply_effort(0.99 * weight)  # 0.046 Nm are missing, friction holds 0.103
    plant.advance(2.0)
    assert plant.position == pytest.approx(STRETCHED, abs=2e-6)
    assert np.abs(plant.velocity).max() < 1e-6


@pytest.mark.parametrize('direction', [-1.0, 1.0])
def test_a_joint_breaks_loose_at_coulomb_plus_load_friction(direction):
    plant = ArmPlant(ROBOT, NOMINAL, UPRIGHT)
    plant.gravity_in_base = (0.0, 0.0, 0.0)
    friction = NOMINAL.coulomb[0]
    plant.apply_effort([0.95 * direction * friction, 0, 0, 0])
    plant.advance(0.3)
    assert abs(plant.velocity[0]) < 1e-6
    # A motor pushing against the held gear loads it, so it also raises the friction.
    plant.apply_effort([1.15 * direction * friction, 0, 0, 0])
    plant.advance(0.3)
    assert direction * plant.velocity[0] > 0.01


def test_carried_weight_does_not_load_the_joints():
    plant = ArmPlant(ROBOT, NOMINAL, STRETCHED)
    plant.support = 1.0
    plant.advance(0.5)
    assert plant.position == pytest.approx(STRETCHED, abs=1e-9)
    plant.support = 0.0
    plant.advance(0.1)
    assert plant.velocity[1] < -0.5


def test_mechanical_stops_end_the_motion():
    plant = ArmPlant(ROBOT, NOMINAL, STRETCHED)
    plant.advance(3.0)
    assert plant.position[1] == pytest.approx(ROBOT.position_min[1] - 0.1, abs=0.05)
    assert np.abs(plant.velocity).max() < 1e-3


def of_robot(robot):
    zero = np.zeros(robot.n)
    names = {'joint_names': robot.joint_names, 'link_names': robot.link_names}
    frictionless = {'viscous': zero, 'coulomb': zero, 'load_friction': zero}
    inertial, rotors = np.array(robot.inertial_parameters), np.full(robot.n, 0.1)
    values = {**names, **frictionless, 'inertial_parameters': inertial, 'rotor_inertia': rotors}
    return replace(NOMINAL, **values)


def test_other_arms_run_too_and_locked_joints_are_refused(example_urdf):
    robot = load_robot(example_urdf('ur10_robot.urdf'))
    plant, model = ArmPlant(robot, of_robot(robot)), Dynamics(robot, np.full(robot.n, 0.1))
    q, dq = np.linspace(-1, 1, robot.n), np.linspace(1, -1, robot.n)
    plant.reset(q, dq)
    plant.step()
    assert model.inverse(q, dq, plant.acceleration) == pytest.approx(np.zeros(robot.n), abs=1e-8)
    fingers = ('panda_finger_joint1', 'panda_finger_joint2')
    robot = load_robot(example_urdf('panda.urdf'), locked=fingers)
    with pytest.raises(PlantError):
        ArmPlant(robot, of_robot(robot))


def test_stribeck_friction_holds_more_than_it_brakes() -> None:
    plant = ArmPlant(ROBOT, replace(NOMINAL, stribeck=0.5, stribeck_velocity=0.05), UPRIGHT)
    plant.gravity_in_base = np.zeros(3)
    coulomb = NOMINAL.coulomb[0]
    plant.apply_effort([1.4 * coulomb, 0.0, 0.0, 0.0])
    plant.advance(0.2)
    assert abs(plant.velocity[0]) < 1e-5  # 1.5 times the dry friction holds it
    plant.apply_effort([1.7 * coulomb, 0.0, 0.0, 0.0])
    plant.advance(0.5)
    plant.apply_effort([1.3 * coulomb, 0.0, 0.0, 0.0])
    before = plant.velocity[0]
    plant.advance(0.1)
    assert before > 0.2
    assert plant.velocity[0] > before  # sliding, it needs less than what held it
