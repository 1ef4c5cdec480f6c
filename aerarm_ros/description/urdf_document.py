"""Parser and checks of joints and links in a URDF, for use before the dynamics library.

The parser of the dynamics library reports a faulty inertia on stderr and continues without it, so
this module checks the URDF first.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import DescriptionError

LOAD_FRICTION = 'load_friction'
"""Name of an attribute of <dynamics>: dry friction per torque transmitted by a gear [-]."""
DAMPING_BESIDE_LOAD, FRICTION_BESIDE_LOAD = 'damping_beside_load', 'friction_beside_load'
"""Names of attributes of <dynamics>: damping and friction without the load-dependent part.

For other programs, `damping` and `friction` include this part at a typical load.
"""
LARGEST = 2**24
"""Largest number of characters of a URDF."""

_DRIVEN_TYPES = ('revolute', 'continuous', 'prismatic')
_DEEPEST = 50
_MOST = 1000  # largest number of links and of joints
_LARGEST_NUMBER = 1e9
# Number of values of each vector attribute, by XML element.
_VECTORS: dict[str, dict[str, int]] = {
    'origin': {'xyz': 3, 'rpy': 3},
    'axis': {'xyz': 3},
    'box': {'size': 3},
    'cylinder': {'radius': 1, 'length': 1},
    'capsule': {'radius': 1, 'length': 1},
    'sphere': {'radius': 1},
    'mesh': {'scale': 3},
}
# Attributes that contain names of links and joints.
_NAMES = (
    ('link', 'name'),
    ('joint', 'name'),
    ('joint/parent', 'link'),
    ('joint/child', 'link'),
    ('joint/mimic', 'joint'),
    ('transmission/joint', 'name'),
    ('ros2_control/joint', 'name'),
    ('gazebo', 'reference'),
)
_KNOWN_TYPES = (*_DRIVEN_TYPES, 'fixed', 'floating', 'planar')


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """Content of a `<joint>` element of a URDF.

    `damping` [Nms/rad] and `friction` [Nm] are attributes of `<dynamics>`, zero if missing.
    `load_friction` [-] is an additional attribute of this package, which other programs ignore.
    """

    name: str
    kind: str
    parent: str
    child: str
    mimics: str | None
    damping: float
    friction: float
    load_friction: float
    has_limit: bool

    @property
    def is_driven(self) -> bool:
        """Whether the joint is revolute, continuous or prismatic."""
        return self.kind in _DRIVEN_TYPES


class UrdfDocument:
    """Joints and links of a URDF text.

    Parameters
    ----------
    text : str
        URDF text.

    Attributes
    ----------
    joints : dict of str to UrdfJoint
        Joints by name.
    links : frozenset of str
        Names of the links.

    Raises
    ------
    DescriptionError
        If the text is not a URDF: not XML, unexpanded xacro, joints without links or without a tree
        structure, invalid numbers.
    """

    def __init__(self, text: str) -> None:
        self._root = _parsed(text)
        if self._root.tag != 'robot':
            raise DescriptionError(f'the root element is <{self._root.tag}>, not <robot>')
        if any('xacro' in element.tag for element in self._root.iter()):
            raise DescriptionError(
                'the file contains xacro macros: expand the macros first (xacro FILE > arm.urdf)'
            )
        _check_numbers(self._root)
        self.links = self._read_links()
        self.joints = self._read_joints()
        self._check_tree()

    def revolute_text(self) -> str:
        """Return the URDF with the type of every continuous joint changed to revolute.

        The angle of a continuous joint is then one number instead of a cosine and a sine, so
        positions and velocities have the same length. The limits of these joints are placeholders.
        """
        root = ET.fromstring(ET.tostring(self._root))
        for element in root.findall('joint'):
            if element.get('type') == 'continuous':
                element.set('type', 'revolute')
                limit = element.find('limit')
                if limit is None:
                    limit = ET.SubElement(element, 'limit', effort='0', velocity='0')
                limit.set('lower', repr(-math.pi))
                limit.set('upper', repr(math.pi))
        return ET.tostring(root, encoding='unicode')

    def prefixed_text(self, prefix: str) -> str:
        """Return the URDF with a prefix added to the name of every link and joint."""
        root = ET.fromstring(ET.tostring(self._root))
        for place, key in _NAMES:
            for element in root.findall(place):
                if element.get(key):
                    element.set(key, prefix + element.attrib[key])
        return ET.tostring(root, encoding='unicode')

    def _read_links(self) -> frozenset[str]:
        names = [_attribute(link, 'name', 'a link') for link in self._root.findall('link')]
        _check_unique('link', names)
        for link in self._root.findall('link'):
            _check_inertial(link)
        return frozenset(names)

    def _read_joints(self) -> dict[str, UrdfJoint]:
        joints = [self._read_joint(element) for element in self._root.findall('joint')]
        _check_unique('joint', [joint.name for joint in joints])
        return {joint.name: joint for joint in joints}

    def _check_tree(self) -> None:
        """Check that every link except the base link is the child of exactly one joint."""
        parent_joint: dict[str, str] = {}
        for joint in self.joints.values():
            if joint.child in parent_joint:
                raise DescriptionError(
                    f'link {joint.child} is the child of two joints, {parent_joint[joint.child]} '
                    f'and {joint.name}'
                )
            parent_joint[joint.child] = joint.name
        bases = sorted(self.links - parent_joint.keys())
        if len(bases) != 1:
            listed = ', '.join(bases) or 'none (the joints form a loop)'
            raise DescriptionError(
                'exactly one link, the base, must not be the child of a joint; links that are no '
                f'child: {listed}'
            )

    def _read_joint(self, element: ET.Element) -> UrdfJoint:
        name = _attribute(element, 'name', 'a joint')
        owner = f'joint {name}'
        kind = _attribute(element, 'type', owner)
        if kind not in _KNOWN_TYPES:
            raise DescriptionError(f'{owner} has the unknown type {kind!r}')
        ends = {}
        for end in ('parent', 'child'):
            link = element.find(end)
            if link is None:
                raise DescriptionError(f'{owner} has no <{end}>')
            ends[end] = _attribute(link, 'link', f'{owner}, <{end}>')
            if ends[end] not in self.links:
                raise DescriptionError(f'{owner}: unknown {end} link {ends[end]!r}')
        limit = element.find('limit')
        if limit is None and kind in ('revolute', 'prismatic'):
            raise DescriptionError(f'{owner} is {kind} and therefore needs a <limit>')
        lower, upper, *_ = (
            _number(limit, key, f'{owner}, <limit>')
            for key in ('lower', 'upper', 'effort', 'velocity')
        )
        if kind != 'continuous' and lower > upper:
            raise DescriptionError(
                f'{owner}, <limit>: lower = {lower:g} is above upper = {upper:g}'
            )
        mimic = element.find('mimic')
        dynamics = element.find('dynamics')
        known = [
            beside if dynamics is not None and dynamics.get(beside) is not None else plain
            for beside, plain in (
                (DAMPING_BESIDE_LOAD, 'damping'),
                (FRICTION_BESIDE_LOAD, 'friction'),
            )
        ]
        return UrdfJoint(
            name=name,
            kind=kind,
            parent=ends['parent'],
            child=ends['child'],
            mimics=None if mimic is None else mimic.get('joint', '?'),
            damping=_number(dynamics, known[0], f'{owner}, <dynamics>'),
            friction=_number(dynamics, known[1], f'{owner}, <dynamics>'),
            load_friction=_number(dynamics, LOAD_FRICTION, f'{owner}, <dynamics>'),
            has_limit=limit is not None,
        )


def numbers_text(values: npt.ArrayLike) -> str:
    """Return numbers as XML text in full precision."""
    return ' '.join(repr(float(value)) for value in np.ravel(values))


def _parsed(text: str) -> ET.Element:
    """Return the root of an XML text, after checks of its size and depth."""
    if len(text) > LARGEST:
        raise DescriptionError(
            f'the file has more than {LARGEST} characters, above the limit for a URDF'
        )
    if '<!DOCTYPE' in text or '<!ENTITY' in text:
        # Entities can expand a small text without limit; the dynamics library ignores them.
        raise DescriptionError(
            'the file declares a document type or entities: remove the declaration, and replace '
            'entities by their text'
        )
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise DescriptionError(f'not valid XML ({error})') from None
    level, depth = [root], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
        if depth > _DEEPEST:
            raise DescriptionError(f'elements are nested more than {_DEEPEST} levels deep')
    for tag in ('link', 'joint'):
        if len(root.findall(tag)) > _MOST:
            raise DescriptionError(
                f'the file has more than {_MOST} {tag}s, above the limit for an arm'
            )
    return root


def _check_numbers(root: ET.Element) -> None:
    """Check that positions, axes and sizes of shapes are finite numbers of plausible magnitude."""
    for owner in (*root.findall('link'), *root.findall('joint')):
        for element in owner.iter():
            for key, count in _VECTORS.get(element.tag, {}).items():
                _check_vector(element, key, count, f'{owner.tag} {owner.get("name")}')


def _check_vector(element: ET.Element, key: str, count: int, owner: str) -> None:
    text = element.get(key)
    if text is None:
        return
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    # Magnitudes are limited so that their squares stay finite.
    if len(values) != count or not all(abs(value) < _LARGEST_NUMBER for value in values):
        raise DescriptionError(
            f'{owner}, <{element.tag}>: {key} = {text[:100]!r} is not {count} finite '
            f'number{"s" if count > 1 else ""}'
        )


def _attribute(element: ET.Element, key: str, owner: str) -> str:
    value = element.get(key)
    if not value:
        raise DescriptionError(f'{owner} has no {key}')
    return value


def _number(element: ET.Element | None, key: str, owner: str) -> float:
    """Return the value of a numeric attribute; zero if the element or the attribute is missing."""
    text = '0' if element is None else element.get(key, '0')
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DescriptionError(f'{owner}: {key} = {text!r} is not a finite number')
    return value


def _check_inertial(link: ET.Element) -> None:
    inertial = link.find('inertial')
    if inertial is None:
        return
    owner = f'link {link.get("name")}, <inertial>'
    for tag, needed, optional in (
        ('mass', ('value',), ()),
        ('inertia', ('ixx', 'iyy', 'izz'), ('ixy', 'ixz', 'iyz')),
    ):
        element = inertial.find(tag)
        if element is None:
            raise DescriptionError(f'{owner} has no <{tag}>')
        for key in needed:
            if element.get(key) is None:
                raise DescriptionError(f'{owner}, <{tag}> has no {key}')
        values = [_number(element, key, owner) for key in (*needed, *optional)]
        if tag == 'mass' and values[0] < 0.0:
            raise DescriptionError(f'{owner}: the mass is negative')


def _check_unique(kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise DescriptionError(f'{kind} {name} is defined {names.count(name)} times')
