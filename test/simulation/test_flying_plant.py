"""Drone and arm as one mechanism: conservation, mass properties, and release."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig, PoseConfig, load_drone_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.arm_plant import SUBSTEP, PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant
from aerarm_ros.simulation.sensors import RandomDrift

START = np.array([0.3, 1.0, -0.4, 0.6])
GRAVITY = np.array([0.0, 0.0, -9.81])
ROBOT = load_robot()
FREE = PlantParameters.nominal(load_arm_config(), ROBOT).perturbed(5).without_friction()


@pytest.fixture
def drone() -> DroneConfig:
    """Return a drone with nothing in its middle and nothing aligned."""
    return replace(
        load_drone_config(),
        centre_of_mass=(0.02, -0.01, 0.015),
        inertia=(0.045, 0.05, 0.08, 0.002, -0.003, 0.001),
        mount=PoseConfig((0.03, 0.01, -0.07), (2.9, 0.2, 0.4)),
        imu=PoseConfig((0.05, -0.04, 0.03), (0.1, -0.2, 0.3)),
    )


@pytest.fixture
def plant(drone: DroneConfig) -> FlyingPlant:
    return FlyingPlant(ROBOT, FREE, START, drone)


def let_tumble(plant: FlyingPlant) -> None:
    plant.reset(START, [0.8, -1.5, 2.0, -1.0])
    plant.let_go()
    plant.push([0.3, 0.1, -0.2, 0.8, -0.6, 1.0])


def momentum(plant: FlyingPlant) -> tuple[np.ndarray, np.ndarray]:
    """Return linear momentum, and angular momentum about the centre of mass, in the world."""
    mujoco.mj_forward(plant._model, plant._data)
    mujoco.mj_subtreeVel(plant._model, plant._data)
    linear = plant._model.body_subtreemass[1] * plant._data.subtree_linvel[1]
    return linear, np.array(plant._data.subtree_angmom[1])


def test_energy_and_momentum_are_conserved_in_free_fall(plant: FlyingPlant) -> None:
    let_tumble(plant)
    energy, (linear, angular) = plant.energy, momentum(plant)
    mass = plant._model.body_subtreemass[1]
    plant.advance(0.5)
    fallen, turned = momentum(plant)
    np.testing.assert_allclose(fallen - linear, 0.5 * mass * GRAVITY, atol=2e-3)
    np.testing.assert_allclose(turned, angular, atol=2e-3 * np.linalg.norm(angular))
    kinetic = 0.5 * mass * (0.5 * 9.81) ** 2
    assert plant.energy == pytest.approx(energy, abs=1e-3 * kinetic)
    assert np.linalg.norm(plant.base.angular_velocity - [0.8, -0.6, 1.0]) > 0.2  # it does tumble


def pinocchio_model(drone: DroneConfig) -> pin.Model:
    """Return arm and drone on a free joint as Pinocchio has them."""
    robot = ROBOT.with_inertial_parameters(FREE.inertial_parameters)
    model, source = pin.Model(), robot.model
    mount = pin.SE3(drone.mount.rotation, np.array(drone.mount.position))
    body = pin.Inertia(drone.mass, np.array(drone.centre_of_mass), drone.inertia_matrix)
    parent = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), 'drone')
    model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.appendBodyToJoint(parent, source.inertias[0], mount)
    for index in range(1, source.njoints):
        place = source.jointPlacements[index]
        parent = model.addJoint(
            parent, source.joints[index], mount * place if index == 1 else place, f'j{index}'
        )
        model.appendBodyToJoint(parent, source.inertias[index], pin.SE3.Identity())
    model.armature = np.concatenate([np.zeros(6), FREE.rotor_inertia])
    return model


def test_inertia_is_that_of_pinocchio(plant: FlyingPlant, drone: DroneConfig) -> None:
    model = pinocchio_model(drone)
    plant.let_go()
    mujoco.mj_forward(plant._model, plant._data)
    full = np.empty((10, 10))
    for row, unit in zip(full, np.eye(10), strict=True):
        mujoco.mj_mulM(plant._model, plant._data, row, unit)
    expected = pin.crba(model, model.createData(), np.concatenate([pin.neutral(model)[:7], START]))
    expected = np.triu(expected) + np.triu(expected, 1).T
    np.testing.assert_allclose(full, expected, atol=1e-9)


def test_rotor_thrust_accelerates_drone_and_arm_by_the_equation_of_motion(
    plant: FlyingPlant, drone: DroneConfig
) -> None:
    model = pinocchio_model(drone)
    data = model.createData()
    let_tumble(plant)
    rng = np.random.default_rng(1)
    for _ in range(5):
        plant.rotors.command(rng.uniform(2.0, 12.0, drone.n))
        plant.advance(0.02)
        position, attitude, velocity, rate = plant.odometry
        q = np.concatenate([position, attitude, plant.position])
        dq = np.concatenate([velocity, rate, plant.velocity])
        plant.step()
        base = plant.base
        rotation = pin.Quaternion(attitude).matrix()
        # Pinocchio's acceleration is that of the components in body axes.
        linear = rotation.T @ base.acceleration - np.cross(rate, velocity)
        ddq = np.concatenate([linear, base.angular_acceleration, plant.acceleration])
        wrench = drone.allocation @ plant.rotors.thrust
        expected = np.concatenate([wrench, np.zeros(4)])
        np.testing.assert_allclose(pin.rnea(model, data, q, dq, ddq), expected, atol=1e-6)


def test_the_imu_measures_the_specific_force_at_its_position(
    plant: FlyingPlant, drone: DroneConfig
) -> None:
    let_tumble(plant)
    body = drone.imu
    place, previous = np.array(body.position), []
    for _ in range(3):
        base = plant.base
        rotation = pin.Quaternion(np.roll(base.quaternion, -1)).matrix()
        spin = rotation @ np.cross(base.angular_velocity, place)
        previous.append((base.position + rotation @ place, base.velocity + spin, rotation))
        plant.step()
    attitude, rate, force = plant.imu
    acceleration = (previous[2][1] - previous[1][1]) / SUBSTEP
    rotation = previous[2][2] @ body.rotation
    np.testing.assert_allclose(force, rotation.T @ (acceleration - GRAVITY), atol=2e-2)
    np.testing.assert_allclose(rate, body.rotation.T @ plant.base.angular_velocity, atol=1e-12)
    here = pin.Quaternion(attitude).matrix()
    np.testing.assert_allclose(here, rotation, atol=1e-3)


def test_it_is_held_until_motors_and_rotors_carry_it() -> None:
    drone = load_drone_config()
    drawn = PlantParameters.nominal(load_arm_config(), ROBOT)
    plant = FlyingPlant(ROBOT, drawn, [0.0, np.pi / 2, 0.0, 0.0], drone)
    plant.support = 1.0
    hover = np.full(drone.n, plant._model.body_subtreemass[1] * 9.81 / drone.n)
    for _ in range(500):
        plant.rotors.command(hover)
        plant.advance(1e-3)
    assert plant.is_held  # somebody still carries the arm
    plant.support = 0.0
    plant.advance(1e-3)
    assert not plant.is_held
    for _ in range(100):
        plant.rotors.command(hover)
        plant.advance(1e-3)
    # The arm hangs straight down, so that equal thrusts are in balance.
    np.testing.assert_allclose(plant.base.position, 0.0, atol=1e-4)
    # Silence: the rotors stop, and it falls.
    plant.advance(0.2 + 1.0)
    assert not plant.rotors.thrust.max() > 1e-6
    assert plant.base.velocity[2] < -8.0
    assert plant.imu[2] == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    # Who carries the arm again holds the drone where it is.
    depth = plant.base.position[2]
    plant.reset(plant.position)
    plant.advance(0.1)
    assert plant.base.position[2] == pytest.approx(depth, abs=1e-9)
    assert plant.imu[2] == pytest.approx([0.0, 0.0, 9.81], abs=1e-3)
    plant.restart(START)
    assert plant.base.position == pytest.approx([0.0, 0.0, 0.0])


def test_a_gust_moves_the_centre_of_mass_and_turns_nothing_by_itself() -> None:
    drone = replace(load_drone_config(), centre_of_mass=(0.05, 0.0, 0.0))
    wind = RandomDrift(4.0, 1e6, 1e-3, np.random.default_rng(2))  # hardly changes
    light = replace(FREE, inertial_parameters=1e-9 * FREE.inertial_parameters)
    plant = FlyingPlant(ROBOT, light, START, drone, gust=wind)
    plant.let_go()
    plant.advance(0.1)
    expected = wind.value / drone.mass + GRAVITY
    np.testing.assert_allclose(plant.base.velocity, 0.1 * expected, rtol=2e-2)
    np.testing.assert_allclose(plant.base.angular_velocity, 0.0, atol=1e-3)
    assert np.linalg.norm(wind.value) > 1.0
