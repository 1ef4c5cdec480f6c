from dataclasses import replace

import numpy as np
import pytest
import yaml

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.inertia import minimum_eigenvalue
from aerarm_ros.simulation.arm_plant import PlantParameters

NOMINAL = PlantParameters.nominal(load_arm_config(), load_robot())


def test_perturbed_links_could_exist_and_deviate_within_their_bounds():
    ratios = {'viscous': 0.3, 'coulomb': 0.3, 'rotor_inertia': 0.2, 'motor_torque_constant': 0.02}
    mass, moment = np.split(NOMINAL.inertial_parameters[:, :4], [1], axis=1)
    nominal = moment / mass
    for seed in range(20):
        made = NOMINAL.perturbed(seed)
        assert minimum_eigenvalue(made.inertial_parameters) > 0.0
        for name, bound in ratios.items():
            ratio = getattr(made, name) / getattr(NOMINAL, name)
            assert np.all(np.abs(ratio - 1.0) <= bound), name
        heavier = np.abs(made.inertial_parameters[:, :1] / mass - 1.0)
        assert 0.02 < heavier.max() <= 0.25
        centre = made.inertial_parameters[:, 1:4] / made.inertial_parameters[:, :1]
        bound = 0.010 * np.sqrt(3.0) + 0.3 * np.linalg.norm(nominal, axis=1)
        assert np.all(np.linalg.norm(centre - nominal, axis=1) <= bound)


def test_written_truth_names_the_regressors_columns():
    parameters = NOMINAL.perturbed(7)
    truth = yaml.safe_load(yaml.safe_dump(parameters.as_dict()))
    assert truth == parameters.as_dict()
    assert len(truth['parameters']) == 52
    assert truth['parameters']['Izz_link4'] == parameters.inertial_parameters[3, 9]
    assert truth['parameters']['fs_joint3'] == parameters.coulomb[2]
    # tau from currents with the nominal constant, over the true torque
    ratio = NOMINAL.motor_torque_constant / parameters.motor_torque_constant
    assert truth['measured_per_true_torque'] == pytest.approx(ratio.tolist())


def test_configuration_and_urdf_must_name_the_same_joints():
    config = load_arm_config()
    renamed = replace(config.joints[0], name='shoulder')
    with pytest.raises(ValueError, match='shoulder'):
        PlantParameters.nominal(replace(config, joints=(renamed, *config.joints[1:])), load_robot())


def test_a_payload_adds_its_mass_where_it_is() -> None:
    carrying = NOMINAL.carrying(0.2, (0.1, 0.0, -0.05), radius=0.03)
    added = carrying.inertial_parameters - NOMINAL.inertial_parameters
    assert not added[:-1].any()
    assert added[-1, :4] == pytest.approx([0.2, 0.02, 0.0, -0.01])
    # Steiner, and 2/5 m r^2 of the ball itself.
    assert added[-1, 6] == pytest.approx(0.2 * (0.1**2 + 0.05**2) + 0.4 * 0.2 * 0.03**2)
