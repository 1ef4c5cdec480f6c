from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters

UNABLE = (
    'joint2: effort_max = 5 Nm cannot carry the outstretched arm with its rated payload, '
    r'which needs \d\.\d\d Nm; check effort_max, rated_payload and the URDF$'
)


@pytest.fixture
def loads(config, robot):
    return JointLoads(config, robot)


def test_the_deceleration_is_there_in_the_worst_postures(loads, config, robot):
    """Checked by the physics engine, with the full rated payload, one joint at a time."""
    mass, *centre = config.rated_payload
    truth = PlantParameters.nominal(config, robot).carrying(mass, centre, 0.001)
    effort_max = config.column('effort_max')
    for posture in ([0.0, 0.0, 0.0, 0.0], [0.0, np.pi, 0.0, 0.0], [0.0, -0.5, 1.5, 1.5]):
        for joint in range(config.n):
            for way in (1.0, -1.0):
                plant = ArmPlant(robot, truth.without_friction(), posture)
                effort = np.zeros(config.n)
                effort[joint] = way * effort_max[joint]
                plant.apply_effort(effort)
                plant.step()
                assert way * plant.acceleration[joint] > loads.deceleration[joint]


def test_the_deceleration_is_not_more_than_the_configuration_allows(loads, config):
    assert (loads.deceleration <= config.column('acceleration_max')).all()
    assert loads.deceleration[2:] == pytest.approx(config.column('acceleration_max')[2:])
    # Joint 2 carries the arm: torque is what limits it.
    assert 4.0 < loads.deceleration[1] < 0.5 * config.joints[1].acceleration_max


def test_the_load_is_the_holding_torque_at_rest(loads, config):
    zero, stretched = np.zeros(4), np.zeros(4)
    guess = np.zeros(4)
    for _ in range(50):  # the torque at which nothing accelerates
        load, inertia = loads.at(stretched, zero, guess)
        guess = np.array(load)
    assert inertia[1] == pytest.approx(0.305, abs=0.005)
    assert guess[1] == pytest.approx(4.68 + 0.5 * 0.2 * 9.81 * 0.75, abs=0.02)


def test_other_joints_pull(loads):
    zero, stretched = np.zeros(4), np.zeros(4)
    alone = loads.at(stretched, zero, np.array([0.0, 5.4, 0.0, 0.0]))[0][3]
    pulled = loads.at(stretched, zero, np.array([0.0, 9.0, 0.0, 0.0]))[0][3]
    assert abs(pulled - alone) > 0.1


def test_a_drive_that_cannot_hold_the_arm_is_refused(config, robot):
    weak = replace(config.joints[1], effort_max=5.0)
    joints = (config.joints[0], weak, *config.joints[2:])
    with pytest.raises(ValueError, match=UNABLE):
        JointLoads(replace(config, joints=joints), robot)
    # Without a payload it does.
    JointLoads(replace(config, joints=joints, rated_payload=(0.0, 0.0, 0.0, 0.0)), robot)


def test_another_arm_is_refused(config):
    others = tuple(replace(joint, name=f'other{i}') for i, joint in enumerate(config.joints))
    with pytest.raises(ValueError, match='URDF .*: pass files of the same arm$'):
        JointLoads(replace(config, joints=others), load_robot())


def test_the_least_damping_slows_a_falling_arm(loads, config, robot):
    """Released while stretched out, with the rated payload, in the physics engine."""
    mass, *centre = config.rated_payload
    truth = PlantParameters.nominal(config, robot).carrying(mass, centre, 0.001)
    plant = ArmPlant(robot, truth, [0.0, 1.0, 0.0, 0.0])
    fastest = 0.0
    while plant.position[1] > config.joints[1].position_min and plant.time < 3.0:
        plant.apply_effort(-loads.damping_min * plant.velocity)
        plant.step()
        fastest = max(fastest, np.abs(plant.velocity).max())
    assert 1.0 < fastest < 0.4 * config.joints[1].velocity_max
    assert (loads.damping_min > 0.0).all()


def test_no_posture_has_more_inertia_and_rotors_count(loads, config, robot):
    random, zero = np.random.default_rng(7), np.zeros(config.n)
    for _ in range(50):
        q = random.uniform(robot.position_min, robot.position_max)
        _, inertia = loads.at(q, zero, zero)
        # Random postures come near to the largest; that of joint 4 is the same in all.
        assert (np.array(inertia) < 1.03 * loads.inertia_max).all()
        assert inertia[3] < loads.inertia_max[3]
    assert (loads.inertia_max > config.column('reflected_inertia')).all()
