"""Holding torques compared with the model: only wrong arms cause warnings."""

import numpy as np

from aerarm_ros.hardware.fault_watch import LoadCheck
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.simulation.arm_plant import PlantParameters

STRETCHED = [0.0, 0.3, 0.0, 0.0]
SETTLED = 2.5  # [s] until the first mean is judged


def warnings(rig, seconds=SETTLED):
    """Hold the arm; return the warnings that name a joint."""
    rig.run(seconds)
    assert rig.bridge.mode == 'ready'
    return [text for text in rig.bridge.faults if text.startswith('joint')]


def test_manufactured_arms_cause_no_load_warning_with_and_without_the_rated_payload(config, robot):
    check, nominal = LoadCheck(config, robot), PlantParameters.nominal(config, robot)
    mass, *centre = config.rated_payload
    random = np.random.default_rng(0)
    for seed in range(60):
        true = nominal.perturbed(seed)
        made = Dynamics(robot.with_inertial_parameters(true.inertial_parameters))
        made.carry(random.choice([0.0, 0.5, 1.0]) * point_mass(mass, centre))
        for q in random.uniform(*robot.posture_range, (20, config.n)):
            load = made.gravity(q)
            friction = random.choice([-1.0, 1.0], config.n) * (
                true.coulomb + true.load_friction * np.abs(load)
            )
            scale = nominal.motor_torque_constant / true.motor_torque_constant
            held = scale * (load + friction)
            assert check.warnings(q, held, held) == [], (seed, q)


def test_a_healthy_arm_on_emulated_boards_is_silent(make_rig, config, robot):
    mass, *centre = config.rated_payload
    parameters = PlantParameters.nominal(config, robot).perturbed(7).carrying(mass, centre, 0.02)
    rig = make_rig(position=STRETCHED, parameters=parameters).bring_up()
    assert warnings(rig) == []


def test_a_weak_driver_and_a_wrong_sign_are_warned_of_while_the_arm_is_held(make_rig):
    weak = make_rig(position=STRETCHED)
    weak.inject('weak_driver', 0, 1, 0.5)
    (text,) = warnings(weak.bring_up())
    assert text.startswith('joint2 delivers ')
    assert 'check the driver of joint2' in text
    weak.send(velocity=[0.0] * 4)
    weak.run(0.02)
    assert not any('was asked for' in fault for fault in weak.bridge.faults)  # it is not held

    turned = make_rig(position=STRETCHED)
    turned.inject('wrong_sign', 0, 1)
    (text,) = warnings(turned.bring_up())
    assert text.startswith('joint2 holds -4.')
    assert 'sign, driver and torque constant of joint2' in text


def test_half_the_torque_behind_a_right_current_is_warned_of_but_not_upright(config, robot):
    check, nominal = LoadCheck(config, robot), PlantParameters.nominal(config, robot)
    load = Dynamics(robot).gravity(np.array(STRETCHED))
    held = 2.0 * load - nominal.coulomb  # friction helps to hold it
    (text,) = check.warnings(np.array(STRETCHED), held, held)
    assert text.startswith('joint2 holds 8.84 Nm')
    assert 'a load of 4.47 Nm, or 5.88 Nm with the rated payload' in text
    home = np.array(config.rest_position)
    assert check.warnings(home, nominal.coulomb, nominal.coulomb) == []  # no joint carries anything
