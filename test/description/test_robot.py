"""Serial arms from URDFs: this one, others, and invalid URDFs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.robot import load_robot

FindUrdf = Callable[[str], Path]
FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')
INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def link(name: str, content: str = INERTIAL) -> str:
    return f'<link name="{name}">{content}</link>'


def joint(parent: str, child: str, kind: str = 'revolute', content: str = LIMIT) -> str:
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>{content}</joint>'
    )


def urdf(*elements: str) -> str:
    return f'<robot name="test">{"".join(elements)}</robot>'


TWO_LINKS = (link('base'), link('a'), link('b'), joint('base', 'a'))


def test_panda_is_read_with_its_fingers_locked(example_urdf: FindUrdf) -> None:
    path = example_urdf('panda.urdf')
    robot = load_robot(path, locked=FINGERS)
    assert robot.joint_names == tuple(f'panda_joint{i}' for i in range(1, 8))
    assert np.allclose(robot.viscous, 0.003)
    by_names = load_robot(path, joint_names=robot.joint_names)
    assert np.array_equal(by_names.inertial_parameters, robot.inertial_parameters)
    with pytest.raises(DescriptionError, match='panda_finger_joint2 mimics panda_finger_joint1'):
        load_robot(path)


def test_locked_links_weigh_on_the_link_that_carries_them() -> None:
    whole = load_robot()
    stiff = load_robot(locked=['joint4'])
    assert stiff.joint_names == ('joint1', 'joint2', 'joint3')
    masses = whole.inertial_parameters[:, 0]
    assert stiff.inertial_parameters[2, 0] == pytest.approx(masses[2] + masses[3])


def test_a_subset_of_joints_is_taken_in_the_order_of_the_chain() -> None:
    assert load_robot(joint_names=['joint2', 'joint4']).joint_names == ('joint2', 'joint4')
    with pytest.raises(DescriptionError, match='order from base to tool: joint2, joint4'):
        load_robot(joint_names=['joint4', 'joint2'])
    for wrong in ({'joint_names': ['joint9']}, {'locked': ['wrist_fixed']}):
        with pytest.raises(DescriptionError, match='the moving joints of the URDF are joint1'):
            load_robot(**wrong)


def test_a_continuous_joint_has_one_angle_and_no_limits() -> None:
    text = urdf(*TWO_LINKS, joint('a', 'b', 'continuous', ''))
    robot = load_robot(text)
    assert robot.model.nq == robot.model.nv == robot.n == 2
    assert robot.path is None
    assert robot.urdf_text == text
    assert list(robot.position_min) == [-1.0, -np.inf]
    assert list(robot.position_max) == [2.0, np.inf]
    assert list(robot.effort_max) == [3.0, np.inf]
    assert list(robot.velocity_max) == [4.0, np.inf]
    limited = load_robot(
        urdf(*TWO_LINKS, joint('a', 'b', 'continuous', '<limit effort="5" velocity="6"/>'))
    )
    assert list(limited.effort_max) == [3.0, 5.0]


def test_a_locked_joint_whose_range_excludes_zero_is_fixed_at_its_nearest_limit() -> None:
    limit = '<limit lower="0.5" upper="1" effort="1" velocity="1"/>'
    point = '<inertial><origin xyz="1 0 0"/>' + INERTIAL.removeprefix('<inertial>')
    text = urdf(link('base'), link('a'), link('b', point), joint('base', 'a'))
    text = text.replace('</robot>', joint('a', 'b', 'revolute', limit) + '</robot>')
    robot = load_robot(text, locked=['b_joint'])
    # 0.5 rad about y brings the point mass from x to -z.
    moment = robot.inertial_parameters[0, 1:4]
    assert np.allclose(moment, [np.cos(0.5), 0.0, 1.0 - np.sin(0.5)])


def test_inertia_and_gravity_can_be_replaced_in_a_copy() -> None:
    robot = load_robot()
    pi = 1.1 * robot.inertial_parameters
    other = robot.with_inertial_parameters(pi)
    assert np.allclose(other.inertial_parameters, pi, rtol=1e-12)
    assert not np.allclose(robot.inertial_parameters, pi)
    unphysical = pi * np.where(np.arange(10) > 3, -1.0, 1.0)
    assert np.allclose(robot.with_inertial_parameters(unphysical).inertial_parameters, unphysical)
    for wrong in (np.ones((3, 10)), np.full((4, 10), np.nan), np.zeros((4, 10))):
        with pytest.raises(ValueError, match='inertial parameters'):
            robot.with_inertial_parameters(wrong)
    hanging = robot.with_gravity([0.0, 0.0, 9.81])
    assert np.array_equal(hanging.gravity_in_base, -robot.gravity_in_base)
    for gravity in ([0.0, np.nan, 0.0], (0.0, -9.81)):
        with pytest.raises(DescriptionError, match='three numbers'):
            robot.with_gravity(gravity)


UNUSABLE = {
    'link without inertia': (
        urdf(*TWO_LINKS[:2], link('b', ''), TWO_LINKS[3], joint('a', 'b')),
        r'link b \(moved by joint b_joint\) has no mass',
    ),
    'branches': (
        urdf(*TWO_LINKS, joint('base', 'b')),
        'not a serial arm: joint b_joint does not follow joint a_joint',
    ),
    'no joints': (urdf(link('base')), 'no joint can move'),
    'floating': (urdf(*TWO_LINKS, joint('a', 'b', 'floating', '')), 'b_joint is floating'),
    'an axis without direction': (
        urdf(*TWO_LINKS, joint('a', 'b')).replace('0 1 0', 'up'),
        'is not 3 finite numbers',
    ),
}


@pytest.mark.parametrize(('text', 'message'), UNUSABLE.values(), ids=UNUSABLE.keys())
def test_an_unusable_urdf_is_refused_with_the_reason(text: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=message) as caught:
        load_robot(text)
    assert '\n' not in str(caught.value)


def test_errors_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / 'arm.urdf'
    with pytest.raises(DescriptionError, match=r'arm\.urdf cannot be read \(No such file'):
        load_robot(path)
    path.write_text(urdf(link('base')))
    with pytest.raises(DescriptionError, match=r'arm\.urdf: no joint'):
        load_robot(str(path))
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(DescriptionError, match='not a text file'):
        load_robot(path)


def test_a_prefix_makes_other_names_and_the_same_arm() -> None:
    plain, prefixed = load_robot(), load_robot(prefix='left_', joint_names=load_robot().joint_names)
    assert prefixed.joint_names == tuple(f'left_{name}' for name in plain.joint_names)
    assert (plain.base_link, prefixed.base_link) == ('base_link', 'left_base_link')
    np.testing.assert_array_equal(prefixed.inertial_parameters, plain.inertial_parameters)
    assert prefixed.path == plain.path
    # Meshes and shapes hang on links by their names.
    assert load_robot(prefixed.urdf_text).joint_names == prefixed.joint_names
    for name in ('tool0', 'left_tool0'):
        assert prefixed.full_name(name) == 'left_tool0'
        assert prefixed.own_name(name) == 'tool0'
    assert prefixed.with_gravity([0.0, 0.0, 9.81]).prefix == 'left_'
    assert load_robot(prefix='l', locked=['joint4']).joint_names[-1] == 'ljoint3'
    # A prefix that some names begin with anyway.
    assert load_robot(prefix='l').full_name('link1') == 'llink1'
