"""The arm's URDF with identified inertia and friction, everything else unchanged."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.parsers import expat

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.linalg import eigh

from aerarm_ros.description.robot import Robot
from aerarm_ros.description.urdf_document import LOAD_FRICTION
from aerarm_ros.model.inertia import barycentric_inertia, is_physically_consistent, pseudo_inertia

Array = npt.NDArray[np.float64]

_REMAINING = 0.9  # of what can be taken off a link at most: the rest must stay a body


@dataclass(frozen=True)
class IdentifiedUrdf:
    """A URDF text, and what the user should know of it."""

    text: str
    warnings: tuple[str, ...]


def identified_urdf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, load: Array | None = None
) -> IdentifiedUrdf:
    """Return the URDF with other inertial and friction values.

    What is identified of a link includes whatever fixed joints hang on it. So the link gets
    it all and those links lose their own `<inertial>`. Links behind locked joints keep theirs,
    which is taken off; where that leaves no possible body, they are written lighter, so that
    every link is physically consistent and their sum is what was identified.

    Parameters
    ----------
    robot : Robot
        As loaded from the original URDF.
    inertial : (n, 10) ndarray
        Of the moving links, thesis (3.3).
    viscous, coulomb : (n,) ndarray
        For `<dynamics damping friction>` [Nms/rad], [Nm].
    load : (n,) ndarray, optional
        Dry friction per torque that the gears pass on, beside these, for `load_friction` [-].
    """
    text = robot.urdf_text
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    links = {link.get('name'): link for link in root.findall('link')}
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    warnings = []
    for index, name in enumerate(robot.link_names):
        fixed = _behind_fixed_joints(root, name)
        held = _held_by_locked_joints(robot, root, [name, *fixed])
        kept = _inertia_held(robot, index) if held else np.zeros(10)
        share = _possible_share(inertial[index], kept)
        if share < 1.0:
            warnings += _scaled(links, held, share, name)
        own = inertial[index] - share * kept
        if not is_physically_consistent(own):
            warnings.append(
                f'identified.urdf: link {name} is NOT PHYSICALLY CONSISTENT: its identified '
                'parameters are those of no body; do not simulate or control with this file'
            )
        for other in fixed:
            _remove_inertial(links[other])
        _set_inertial(links[name], own)
        share = 0.0 if load is None else load[index]
        _set_dynamics(joints[robot.joint_names[index]], viscous[index], coulomb[index], share)
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


def _held_by_locked_joints(robot: Robot, root: ET.Element, links: list[str]) -> list[str]:
    """Return the links that only locked (and fixed) joints connect to some links."""
    found: list[str] = []
    front = links
    while front:
        children = _children(root, front, fixed=False)
        behind = [child for joint, child in children if joint not in robot.joint_names]
        front = [link for child in behind for link in (child, *_behind_fixed_joints(root, child))]
        found += front
    return found


def _inertia_held(robot: Robot, index: int) -> Array:
    """Return the inertial parameters, in the moving link's frame, of what locked joints carry."""
    full = pin.buildModelFromXML(robot.urdf_text)
    data = full.createData()
    posture = pin.neutral(full)
    posture = np.clip(posture, full.lowerPositionLimit, full.upperPositionLimit)
    pin.forwardKinematics(full, data, posture)
    carrier = full.getJointId(robot.joint_names[index])
    total = np.zeros(10)
    for body in range(1, full.njoints):
        if body == carrier or _moving_ancestor(full, body, robot.joint_names) != carrier:
            continue
        placed = data.oMi[carrier].actInv(data.oMi[body]).act(full.inertias[body])
        total += placed.toDynamicParameters()
    return total


def _moving_ancestor(full: Any, joint: int, moving: tuple[str, ...]) -> int:
    """Return the nearest joint towards the base that moves, maybe itself; 0 for the base."""
    while joint > 0 and full.names[joint] not in moving:
        joint = full.parents[joint]
    return joint


def _possible_share(whole: Array, kept: Array) -> float:
    """Return how much of a part can be taken off a body such that a body remains."""
    if not kept.any() or is_physically_consistent(whole - kept):
        return 1.0
    if not is_physically_consistent(whole):
        return 0.0
    # P - s K stays positive definite up to s = 1 / (largest eigenvalue of K by P).
    largest = eigh(pseudo_inertia(kept), pseudo_inertia(whole), eigvals_only=True)[-1]
    return float(_REMAINING / largest)


def _scaled(
    links: Mapping[str | None, ET.Element], held: list[str], share: float, carrier: str
) -> list[str]:
    """Make links lighter, centres and shapes as they are; return what is to be said of it."""
    for name in held:
        for element in (
            *links[name].iterfind('inertial/mass'),
            *links[name].iterfind('inertial/inertia'),
        ):
            for key, value in element.items():
                element.set(key, repr(share * float(value)))
    return [
        f'identified.urdf: the links behind locked joints ({", ".join(held)}) were written with '
        f'{100.0 * share:.3g} % of their mass: as heavy as in the URDF, they would leave of '
        f'{carrier} no possible body; check their inertia in the URDF'
    ]


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


def _set_dynamics(joint: ET.Element, damping: float, friction: float, load: float) -> None:
    dynamics = joint.find('dynamics')
    if dynamics is None:
        dynamics = ET.SubElement(joint, 'dynamics')
    dynamics.set('damping', repr(float(damping)))
    dynamics.set('friction', repr(float(friction)))
    dynamics.attrib.pop(LOAD_FRICTION, None)  # of the URDF that this was
    if load:
        dynamics.set(LOAD_FRICTION, repr(float(load)))
