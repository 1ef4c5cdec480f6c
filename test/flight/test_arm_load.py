"""The arm's load compared with the physics engine: feedforward keeps a free drone still."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.control.base.rotor_wrench import carrier_parameters
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, MassProperties, at_drone_centre
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant

DRONE = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
ROBOT = load_robot(gravity_in_base=DRONE.gravity_in_base)
PLANT = PlantParameters.nominal(load_arm_config(), ROBOT)


def motions(count: int = 10) -> list[JointReference]:
    random = np.random.default_rng(2)
    rows = random.normal(size=(count, 3, 4)) * np.array([1.0, 2.0, 5.0])[:, np.newaxis]
    return [JointReference(*row) for row in rows]


def test_rotors_that_carry_weight_and_motion_keep_the_drone_still() -> None:
    """The engine's inverse dynamics of a drone at rest whose joints move."""
    plant = FlyingPlant(ROBOT, PLANT, np.zeros(4), DRONE)
    model, data = plant._model, plant._data
    plant.let_go()
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    loads = ArmLoadModel(ROBOT)
    rotation, mount = DRONE.mount.rotation, np.array(DRONE.mount.position)
    for motion in motions():
        data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        data.qvel[:6] = data.qacc[:6] = 0.0
        data.qpos[7:], data.qvel[6:], data.qacc[6:] = motion
        model.opt.gravity[:] = [0.0, 0.0, -9.81]
        mujoco.mj_inverse(model, data)
        load = loads.evaluate(motion)
        wrench = load.weight + load.motion
        force = rotation @ wrench[:3] + [0.0, 0.0, -9.81 * DRONE.mass]
        moment = rotation @ wrench[3:] + np.cross(mount, rotation @ wrench[:3])
        np.testing.assert_allclose(data.qfrc_inverse[:3], -force, atol=1e-9)
        np.testing.assert_allclose(data.qfrc_inverse[3:6], -moment, atol=1e-9)


def test_the_acceleration_is_the_whole_bodys_answer_taken_back() -> None:
    whole = WholeBodyDynamics(ROBOT, carrier=carrier_parameters(DRONE))
    loads = ArmLoadModel(ROBOT)
    for motion in motions():
        load = loads.evaluate(motion)
        answer = whole.response(motion.q)[0] @ load.motion
        np.testing.assert_allclose(load.acceleration(DRONE), -answer, atol=1e-9)


def test_at_the_drones_centre_the_body_turns_alike() -> None:
    acceleration = np.array([0.3, -0.2, 0.1, 1.0, -2.0, 0.5])
    moved = at_drone_centre(acceleration, DRONE)
    rotation = DRONE.mount.rotation
    np.testing.assert_allclose(moved[3:], rotation @ acceleration[3:])
    # And back, from the centre to the mount.
    lever = np.array(DRONE.mount.position) - DRONE.centre_of_mass
    back = moved[:3] + np.cross(moved[3:], lever)
    np.testing.assert_allclose(rotation.T @ back, acceleration[:3], atol=1e-12)


def test_the_arm_load_includes_the_payload() -> None:
    loads = ArmLoadModel(ROBOT)
    motion = JointReference.at_rest([0.2, 1.3, -0.4, 0.6])
    empty = loads.evaluate(motion)
    loads.dynamics.carry([0.2, *[0.0] * 9])
    full = loads.evaluate(motion)
    assert full.mass - empty.mass == pytest.approx(0.2)
    added = full.weight - empty.weight
    np.testing.assert_allclose(added[:3], 0.2 * ROBOT.gravity_in_base, atol=1e-12)
    where = (full.mass * full.com - empty.mass * empty.com) / 0.2
    np.testing.assert_allclose(added[3:], np.cross(where, added[:3]), atol=1e-12)
    np.testing.assert_allclose(full.motion, 0.0, atol=1e-12)


def test_mass_properties_of_drone_and_arm_agree_with_pinocchio() -> None:
    drone = load_drone_config()
    arm = pin.Inertia(1.5, np.array([0.02, -0.01, 0.4]), np.diag([0.08, 0.09, 0.01]))
    both = MassProperties.of(drone, arm.mass, arm.lever, arm.inertia)
    mount = pin.SE3(drone.mount.rotation, np.array(drone.mount.position))
    body = pin.Inertia(drone.mass, np.array(drone.centre_of_mass), drone.inertia_matrix)
    expected = body + mount.act(arm)
    assert both.mass == expected.mass
    np.testing.assert_allclose(both.centre, expected.lever, atol=1e-12)
    np.testing.assert_allclose(both.inertia, expected.inertia, atol=1e-12)
