"""config/moveit agrees with the URDF, the configuration and the executables."""

from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource

CONFIG = load_arm_config()
URDF = ElementTree.parse(resource('urdf', 'aerarm.urdf')).getroot()
SRDF = ElementTree.parse(resource('config', 'moveit', 'aerarm.srdf')).getroot()


def read(name: str) -> dict:
    return yaml.safe_load(resource('config', 'moveit', f'{name}.yaml').read_text())


def test_the_group_is_a_chain_of_the_urdf_with_all_joints() -> None:
    assert SRDF.get('name') == URDF.get('name')
    chain = SRDF.find('group/chain')
    above = {joint.find('child').get('link'): joint for joint in URDF.iter('joint')}
    link, passed = chain.get('tip_link'), []
    while link != chain.get('base_link'):
        passed.append(above[link].get('name'))
        link = above[link].find('parent').get('link')
    assert [name for name in passed[::-1] if not name.endswith('_fixed')] == list(
        CONFIG.joint_names
    )


def test_the_named_posture_is_the_rest_position() -> None:
    (state,) = SRDF.iter('group_state')
    values = {joint.get('name'): float(joint.get('value')) for joint in state}
    assert [values[name] for name in CONFIG.joint_names] == list(CONFIG.rest_position)


def test_only_pairs_that_a_joint_holds_together_are_left_out() -> None:
    joined = [
        sorted((joint.find('parent').get('link'), joint.find('child').get('link')))
        for joint in URDF.iter('joint')
        if joint.get('type') != 'fixed'
    ]
    pairs = SRDF.iter('disable_collisions')
    assert [sorted((pair.get('link1'), pair.get('link2'))) for pair in pairs] == joined


@pytest.mark.parametrize('what', ['velocity', 'acceleration'])
def test_plans_use_half_of_the_limits(what: str) -> None:
    limits = read('joint_limits')['joint_limits']
    assert all(limits[name][f'has_{what}_limits'] for name in CONFIG.joint_names)
    planned = [limits[name][f'max_{what}'] for name in CONFIG.joint_names]
    np.testing.assert_allclose(planned, 0.5 * CONFIG.column(f'{what}_max'))
