"""The arm's URDF with identified inertia and friction, everything else unchanged."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from xml.parsers import expat

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import barycentric_inertia, is_physically_consistent

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class IdentifiedUrdf:
    """A URDF text, and what the user should know of it."""

    text: str
    warnings: tuple[str, ...]


def identified_urdf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array
) -> IdentifiedUrdf:
    """Return the URDF with other inertial and friction values.

    What is identified of a link includes whatever fixed joints hang on it. So the link gets
    it all and those links lose their own `<inertial>`. Links behind locked joints keep theirs,
    which is taken off.

    Parameters
    ----------
    robot : Robot
        As loaded from the original URDF.
    inertial : (n, 10) ndarray
        Of the moving links, thesis (3.3).
    viscous, coulomb : (n,) ndarray
        For `<dynamics damping friction>` [Nms/rad], [Nm].
    """
    text = robot.urdf_text
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    links = {link.get('name'): link for link in root.findall('link')}
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    warnings = []
    for index, name in enumerate(robot.link_names):
        fixed = _behind_fixed_joints(root, name)
        kept = _held_by_locked_joints(robot, root, [name, *fixed], index)
        own = inertial[index] - kept
        if kept.any() and not is_physically_consistent(own):
            warnings.append(
                f'identified.urdf: link {name} without what its locked joints carry is not '
                'physically consistent: the identified total is smaller than the CAD part'
            )
        for other in fixed:
            _remove_inertial(links[other])
        _set_inertial(links[name], own)
        _set_dynamics(joints[robot.joint_names[index]], viscous[index], coulomb[index])
    # The serializer's blank before '/>' would show up in every line of a comparison.
    written = ET.tostring(root, encoding='unicode').replace(' />', '/>')
    return IdentifiedUrdf(_before_root(text) + written + '\n', tuple(warnings))


def _before_root(text: str) -> str:
    """Return declaration and comments in front of the root, which the tree doesn't have."""
    starts: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *_: starts.append(parser.CurrentByteIndex)
    encoded = text.encode()
    parser.Parse(encoded, True)
    return encoded[: starts[0]].decode()


def _children(root: ET.Element, parents: list[str], fixed: bool) -> list[tuple[str, str]]:
    """Return joint and child link of the joints on some links: the fixed ones, or the others."""
    found = []
    for joint in root.findall('joint'):
        parent, child = joint.find('parent'), joint.find('child')
        assert parent is not None and child is not None
        if parent.get('link') in parents and (joint.get('type') == 'fixed') == fixed:
            found.append((joint.get('name', ''), child.get('link', '')))
    return found


def _behind_fixed_joints(root: ET.Element, link: str) -> list[str]:
    found: list[str] = []
    front = [link]
    while front:
        front = [child for _, child in _children(root, front, fixed=True)]
        found += front
    return found


def _held_by_locked_joints(robot: Robot, root: ET.Element, links: list[str], index: int) -> Array:
    """Return the inertial parameters, in the moving link's frame, of what locked joints carry."""
    total = np.zeros(10)
    locked = [j for j, _ in _children(root, links, fixed=False) if j not in robot.joint_names]
    if not locked:
        return total
    full = pin.buildModelFromXML(robot.urdf_text)
    data = full.createData()
    posture = pin.neutral(full)
    posture = np.clip(posture, full.lowerPositionLimit, full.upperPositionLimit)
    pin.forwardKinematics(full, data, posture)
    carrier = data.oMi[full.getJointId(robot.joint_names[index])]
    for joint in locked:
        for body in full.subtrees[full.getJointId(joint)]:
            placed = carrier.actInv(data.oMi[body]).act(full.inertias[body])
            total += placed.toDynamicParameters()
    return total


def _set_inertial(link: ET.Element, pi: Array) -> None:
    inertial = link.find('inertial')
    if inertial is None:
        inertial = ET.Element('inertial')
        inertial.tail = '\n    '
        link.insert(0, inertial)
    centre, tensor = pi[1:4] / pi[0], barycentric_inertia(pi)
    values = {
        'origin': {'xyz': ' '.join(repr(float(c)) for c in centre), 'rpy': '0 0 0'},
        'mass': {'value': repr(float(pi[0]))},
        'inertia': {
            f'i{a}{b}': repr(float(tensor[i, j]))
            for i, a in enumerate('xyz')
            for j, b in enumerate('xyz')
            if i <= j
        },
    }
    for tag, attributes in values.items():
        element = inertial.find(tag)
        if element is None:
            element = ET.SubElement(inertial, tag)
        for key, value in attributes.items():
            element.set(key, value)


def _remove_inertial(link: ET.Element) -> None:
    inertial = link.find('inertial')
    if inertial is not None:
        link.remove(inertial)


def _set_dynamics(joint: ET.Element, damping: float, friction: float) -> None:
    dynamics = joint.find('dynamics')
    if dynamics is None:
        dynamics = ET.SubElement(joint, 'dynamics')
    dynamics.set('damping', repr(float(damping)))
    dynamics.set('friction', repr(float(friction)))
