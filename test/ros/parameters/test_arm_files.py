"""The arm that a node's parameters name."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.description.resources import resource
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, load_arm


def values(**given: str) -> SimpleNamespace:
    """Return the parameters as a node has them, those not given empty."""
    return SimpleNamespace(**{parameter.name: parameter.default for parameter in ARM_FILES} | given)


def test_the_packaged_arm_unless_others_are_named(tmp_path: Path) -> None:
    packaged, robot = load_arm(values())
    assert robot.joint_names == packaged.joint_names
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(robot.urdf_text)
    assert load_arm(values(urdf=str(urdf)))[1].path == urdf


def test_gravity_and_joints_are_those_of_the_configuration(tmp_path: Path) -> None:
    text = resource('config', 'aerarm.yaml').read_text()
    hanging = tmp_path / 'hanging.yaml'
    hanging.write_text(text.replace('[0.0, 0.0, -9.81]', '[0.0, 0.0, 9.81]'))
    config, robot = load_arm(values(config=str(hanging)))
    assert config.gravity_in_base == (0.0, 0.0, 9.81)
    np.testing.assert_array_equal(robot.gravity_in_base, [0.0, 0.0, 9.81])
    renamed = tmp_path / 'renamed.yaml'
    renamed.write_text(text.replace('joint1', 'shoulder'))
    with pytest.raises(ValueError, match="unknown moving joint 'shoulder'"):
        load_arm(values(config=str(renamed)))


def test_the_prefix_is_before_the_names_of_both(tmp_path: Path) -> None:
    text = resource('config', 'aerarm.yaml').read_text()
    coupled = tmp_path / 'coupled.yaml'
    coupled.write_text(text + 'coupled_joints: [[joint4, joint3]]\n')
    config, robot = load_arm(values(config=str(coupled), tf_prefix='left_'))
    assert config.joint_names == robot.joint_names
    assert robot.joint_names[0] == 'left_joint1'
    assert config.coupled_joints == (('left_joint4', 'left_joint3'),)
    with pytest.raises(ValueError, match='tf_prefix'):
        load_arm(values(tf_prefix='/left'))
    assert load_arm(values())[1].urdf_text == resource('urdf', 'aerarm.urdf').read_text()


@pytest.mark.parametrize('name', ['config', 'urdf'])
def test_a_file_that_is_not_there_is_named(name: str) -> None:
    with pytest.raises(ValueError, match='/nowhere/arm'):
        load_arm(values(**{name: '/nowhere/arm'}))
