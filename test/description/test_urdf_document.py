"""Faults of a URDF are detected before the dynamics library reads it."""

import pytest

from aerarm_ros.description.config_reader import DescriptionError, check_prefix
from aerarm_ros.description.resources import resource
from aerarm_ros.description.urdf_document import UrdfDocument

ARM = resource('urdf', 'aerarm.urdf').read_text()


LOOP = '<joint name="back" type="fixed"><parent link="tool0"/><child link="base_link"/></joint>'
MACRO = '<x:macro xmlns:x="http://www.ros.org/wiki/xacro"/>'
LIMIT = '<limit lower="-0.523" upper="3.664" effort="9.39" velocity="5.0"/>'
FAULTS = [
    # text, its replacement, message
    ('<robot', 'robot', 'not valid XML'),
    ('robot', 'sdf', 'root element is <sdf>'),
    ('<link name="wrist"/>', MACRO, 'expand the macros first'),
    ('<link name="wrist"/>', '<link/>', 'a link has no name'),
    ('name="tool0"/>', 'name="wrist"/>', 'link wrist is defined 2 times'),
    ('name="joint2"', 'name="joint1"', 'joint joint1 is defined 2 times'),
    ('type="fixed"', 'type="welded"', "unknown type 'welded'"),
    ('<parent link="link1"/>', '', 'joint joint2 has no <parent>'),
    ('<child link="link2"/>', '<child link="x"/>', "link 'x'"),
    ('<child link="tool0"/>', '<child link="link3"/>', 'link link3 is the child of two joints'),
    ('<link name="wrist"/>', '<link name="wrist"/><link name="x"/>', 'base_link, x'),
    ('</robot>', f'{LOOP}</robot>', 'the joints form a loop'),
    (LIMIT, '', 'joint2 is revolute and therefore needs a <limit>'),
    ('lower="-0.523"', 'lower="5.23"', '<limit>: lower = 5.23 is above upper = 3.664'),
    ('upper="3.664"', 'upper="nan"', "upper = 'nan'"),
    ('friction="0.247"', 'friction="high"', "friction = 'high'"),
    ('friction="0.247"', 'friction="0.2" load_friction="much"', "load_friction = 'much'"),
    ('<mass value="0.554"/>', '', 'link link2, <inertial> has no <mass>'),
    ('<mass value="0.554"/>', '<mass/>', '<mass> has no value'),
    ('value="0.554"', 'value="nan"', "value = 'nan'"),
    ('value="0.554"', 'value="-1"', 'the mass is negative'),
    ('izz="0.000153"', 'izz="1,5e-4"', "izz = '1,5e-4'"),
    ('izz="0.000153"', '', '<inertia> has no izz'),
]


@pytest.mark.parametrize(('old', 'new', 'message'), FAULTS)
def test_a_fault_is_named(old: str, new: str, message: str) -> None:
    text = ARM.replace(old, new)
    assert text != ARM
    with pytest.raises(DescriptionError) as caught:
        UrdfDocument(text)
    assert message in str(caught.value)


DECLARED = ''.join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9))
ENTITIES = f'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">{DECLARED}]>'
WEAPONS = {
    'entities': (ENTITIES + ARM.partition('?>')[2].lstrip(), 'document type or entities'),
    'depth': (
        ARM.replace(
            '<link name="wrist"/>', '<link name="wrist">' + '<a>' * 5000 + '</a>' * 5000 + '</link>'
        ),
        'nested more than 50 levels deep',
    ),
    'links': (
        ARM.replace('</robot>', ''.join(f'<link name="x{k}"/>' for k in range(1100)) + '</robot>'),
        'more than 1000 links',
    ),
    'size': ('<robot>' + ' ' * 2**24 + '</robot>', 'has more than 16777216 characters'),
}


@pytest.mark.parametrize('weapon', WEAPONS)
def test_urdf_that_needs_much_memory_or_time_is_rejected(weapon: str) -> None:
    text, message = WEAPONS[weapon]
    with pytest.raises(DescriptionError, match=message):
        UrdfDocument(text)


@pytest.mark.parametrize('value', ['nan nan nan', '1e300 0 0', '0 0', '0 0 x', ''])
@pytest.mark.parametrize('element', ['origin', 'axis'])
def test_places_and_axes_are_finite_numbers(element: str, value: str) -> None:
    _, _, rest = ARM.partition(f'<{element} xyz="')
    old = rest.partition('"')[0]
    changed = ARM.replace(f'<{element} xyz="{old}"', f'<{element} xyz="{value}"')
    assert changed != ARM
    with pytest.raises(DescriptionError, match=f'<{element}>: xyz = .* is not 3 finite numbers'):
        UrdfDocument(changed)


def test_a_prefix_is_added_to_all_names_and_changes_nothing_else() -> None:
    extras = (
        '<gazebo reference="link1"/><gazebo/>'
        '<transmission name="t"><joint name="joint1"/></transmission></robot>'
    )
    text = ARM.replace('</robot>', extras).replace(
        '<limit lower="-2.094"', '<mimic joint="joint1"/><limit lower="-2.094"'
    )
    plain, prefixed = UrdfDocument(text), UrdfDocument(UrdfDocument(text).prefixed_text('left/'))
    assert prefixed.links == {f'left/{name}' for name in plain.links}
    assert list(prefixed.joints) == [f'left/{name}' for name in plain.joints]
    assert prefixed.joints['left/joint4'].mimics == 'left/joint1'
    # Each name once taken back, it is the same document.
    assert prefixed.prefixed_text('').replace('left/', '') == plain.prefixed_text('')


def test_prefixes_are_names() -> None:
    for prefix in ('', 'left_', 'left/', 'fleet/arm2_', 'L'):
        check_prefix(prefix)
    for prefix in ('/left', '_', '1st_', 'left arm', 'left//', 'left-', 'léft_', 'a\n', 65 * 'a'):
        with pytest.raises(DescriptionError, match='must begin with a letter .* left_'):
            check_prefix(prefix)
