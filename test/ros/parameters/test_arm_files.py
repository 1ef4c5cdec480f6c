"""The arm and the drone that a node's parameters name."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from aerarm_ros.description.resources import resource
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, load_arm, load_drone


def values(**given: object) -> SimpleNamespace:
    """Return the parameters as a node has them, those not given empty."""
    defaults = {parameter.name: parameter.default for parameter in ARM_FILES}
    return SimpleNamespace(**{**defaults, 'drone_file': '', **given})


def changed(folder: Path, old: str, new: str) -> Path:
    """Write the packaged configuration with another text."""
    path = folder / 'changed.yaml'
    text = resource('config', 'aerarm.yaml').read_text()
    path.write_text(text.replace(old, new) if old else text + new)
    return path


def test_the_arm_is_that_of_the_files_or_the_packaged_one(tmp_path: Path) -> None:
    packaged, robot = load_arm(values())
    assert robot.joint_names == packaged.joint_names
    assert robot.urdf_text == resource('urdf', 'aerarm.urdf').read_text()
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(robot.urdf_text)
    assert load_arm(values(urdf=str(urdf)))[1].path == urdf
    hanging = changed(tmp_path, '[0.0, 0.0, -9.81]', '[0.0, 0.0, 9.81]')
    config, robot = load_arm(values(config=hanging))
    assert config.gravity_in_base == (0.0, 0.0, 9.81)
    np.testing.assert_array_equal(robot.gravity_in_base, [0.0, 0.0, 9.81])
    coupled = changed(tmp_path, '', 'coupled_joints: [[joint4, joint3]]\n')
    config, robot = load_arm(values(config=coupled, tf_prefix='left_'))
    assert config.joint_names == robot.joint_names
    assert robot.joint_names[0] == 'left_joint1'
    assert config.coupled_joints == (('left_joint4', 'left_joint3'),)


def test_wrong_files_and_prefixes_are_named(tmp_path: Path) -> None:
    for given, problem in (
        ({'config': '/nowhere/arm'}, '/nowhere/arm'),
        ({'urdf': '/nowhere/arm'}, '/nowhere/arm'),
        ({'tf_prefix': '/left'}, 'tf_prefix'),
        ({'config': changed(tmp_path, 'joint1', 'shoulder')}, "unknown moving joint 'shoulder'"),
    ):
        with pytest.raises(ValueError, match=problem):
            load_arm(values(**given))


def test_only_a_drone_that_lifts_the_arm_is_accepted(tmp_path: Path) -> None:
    arm = load_arm(values())
    assert load_drone(values(), *arm) is None
    packaged = resource('config', 'drones', 'quadrotor.yaml')
    drone = load_drone(values(drone_file=str(packaged)), *arm)
    assert drone is not None
    assert drone.name == 'quadrotor'
    document = yaml.safe_load(packaged.read_text())
    for rotor in document['rotors']:
        rotor['thrust_max'] = 6.0
    path = tmp_path / 'weak.yaml'
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(ValueError, match=r'drone and arm \(1\.3 \+ 1\.49 kg\)'):
        load_drone(values(drone_file=str(path)), *arm)
