"""Chain of joints from the arm's base to the link that carries the observed markers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot, load_robot
from aerarm_ros.description.urdf_document import UrdfDocument, UrdfJoint
from aerarm_ros.identification.recording.table_file import some_names

# [kg] mass given to a link that has none in the URDF, so that the URDF can be loaded
_LIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class Chain:
    """Serial arm of a URDF, reduced to the joints that move the observed link.

    Attributes
    ----------
    robot : Robot
        Robot with only the joints that move the link; all others are locked.
    link : str
        Link that carries the observed markers or poses.
    ignored : tuple of str
        Joints with recorded positions that do not move the link.
    text : str
        Original text of the URDF.
    has_masses : bool
        Whether the URDF contains masses, so that gravity torques are known.
    """

    robot: Robot
    link: str
    ignored: tuple[str, ...]
    text: str
    has_masses: bool


def chain_of(
    text: str,
    recorded: Collection[str],
    link: str = '',
    locked: Sequence[str] = (),
    gravity_in_base: Sequence[float] = STANDARD_GRAVITY,
) -> Chain:
    """Return the chain of joints with recorded positions that moves a link.

    Parameters
    ----------
    text : str
        Text of the URDF.
    recorded : collection of str
        Joints with known positions; joints that do not move the link are ignored.
    link : str
        Link to which the observations are attached; if empty, the link after the last recorded
        joint.
    locked : sequence of str
        Joints between base and link that did not move during the recording.
    gravity_in_base : (3,) sequence
        Gravity in the base frame [m/s^2].

    Raises
    ------
    CalibrationError
        If the link is unknown or ambiguous, or a joint of the chain has no recorded positions.
    DescriptionError
        If the text is not a URDF.
    """
    document = UrdfDocument(text)
    above = {joint.child: joint for joint in document.joints.values()}
    driven = {name for name, joint in document.joints.items() if joint.is_driven}
    known = [name for name in recorded if name in driven]
    if not known:
        raise CalibrationError(
            f'none of the recorded joints ({some_names(recorded)}) is a joint of the URDF '
            f'({some_names(sorted(driven))}): check the URDF, or rename the columns'
        )
    link = link or _last_link(document, above, known)
    if link not in document.links:
        raise CalibrationError(
            f"link {link} (--link) is unknown: choose one of the URDF's links, "
            f'{some_names(sorted(document.links))}'
        )
    path = []
    at = link
    while at in above:
        path.append(above[at])
        at = above[at].parent
    moving = [j.name for j in reversed(path) if j.is_driven and j.name not in locked]
    missing = [name for name in moving if name not in known]
    if missing:
        raise CalibrationError(
            f'joint {missing[0]} moves link {link}, but has no recorded positions (recorded: '
            f'{some_names(recorded)}): record them, or pass --lock {missing[0]} if the joint '
            'stayed at zero'
        )
    if not moving:
        raise CalibrationError(f'no recorded joint moves link {link} (--link): name another link')
    children = [document.joints[name].child for name in moving]
    light, has_masses = _with_masses(text, children)
    robot = load_robot(light, gravity_in_base=gravity_in_base, joint_names=moving)
    ignored = tuple(name for name in recorded if name not in moving)
    return Chain(robot, link, ignored, text, has_masses)


def _last_link(document: UrdfDocument, above: dict[str, UrdfJoint], known: Sequence[str]) -> str:
    """Return the link that the last recorded joint of the chain moves."""
    ends = []
    for name in known:
        inner = {j for j in known if j != name}
        at, passed = document.joints[name].parent, set()
        while at in above:
            joint = above[at]
            passed.add(joint.name)
            at = joint.parent
        ends.append((len(passed & inner), name))
    most = max(count for count, _ in ends)
    last = [name for count, name in ends if count == most]
    if len(last) > 1 or most < len(known) - 1:
        behind = [document.joints[name].child for count, name in sorted(ends)[::-1]]
        raise CalibrationError(
            'the recorded joints belong to several chains: name the link that carries the markers '
            f'with --link, for example {", ".join(behind[:3])}'
        )
    return document.joints[last[0]].child


def _with_masses(text: str, links: Sequence[str]) -> tuple[str, bool]:
    """Return the URDF with a mass added to links without mass, and whether no mass was missing."""
    root = ET.fromstring(text)
    lacking = [
        element
        for element in root.findall('link')
        if element.get('name') in links and not _mass(element) > 0.0
    ]
    for element in lacking:
        for old in element.findall('inertial'):
            element.remove(old)
        inertial = ET.SubElement(element, 'inertial')
        ET.SubElement(inertial, 'mass', value=repr(_LIGHT))
        moment = {key: repr(1e-9 if key[1] == key[2] else 0.0) for key in _ENTRIES}
        ET.SubElement(inertial, 'inertia', moment)
    if not lacking:
        return text, True
    # If some masses of an arm are missing, its gravity torques are unknown.
    return ET.tostring(root, encoding='unicode'), False


_ENTRIES = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


def _mass(link: ET.Element) -> float:
    element = link.find('inertial/mass')
    try:
        return float(element.get('value', '0')) if element is not None else 0.0
    except ValueError:
        return 0.0
