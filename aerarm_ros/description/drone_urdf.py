"""URDF of drone and arm together."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.drone_config import DroneConfig, PoseConfig
from aerarm_ros.description.urdf_document import UrdfDocument, numbers_text

BODY_LINK, IMU_LINK = 'drone', 'drone_imu'

_SPAN = 0.14  # [m] radius with which a rotor is drawn
_COLOURS = {'drone_body': '0.25 0.27 0.30 1', 'drone_rotor': '0.55 0.60 0.66 0.5'}


def with_drone(urdf_text: str, drone: DroneConfig, prefix: str = '') -> str:
    """Return the URDF of a drone with its arm; the arm's base link is fixed to the link `drone`.

    The visual shapes show the body as a box, the rotor arms, and the rotors as discs. The frame
    of the link `drone_imu` is the IMU's frame. Mass and inertia are those of the drone file.

    Parameters
    ----------
    urdf_text : str
        URDF text of the arm.
    prefix : str
        Prefix of the names of the drone's links and joints, equal to the prefix of the arm's
        names.

    Raises
    ------
    DescriptionError
        If the arm has links or joints with these names, or no base link.
    """
    root = ET.fromstring(urdf_text)
    body, imu = prefix + BODY_LINK, prefix + IMU_LINK
    base = _base_link(urdf_text, {body, imu})
    for name, colour in _COLOURS.items():
        ET.SubElement(ET.SubElement(root, 'material', name=name), 'color', rgba=colour)
    _add_body(root, body, drone)
    ET.SubElement(root, 'link', name=imu)
    _fix(root, f'{body}_mount', (body, base), drone.mount)
    _fix(root, f'{imu}_fixed', (body, imu), drone.imu)
    ET.indent(root)
    return ET.tostring(root, encoding='unicode')


def _base_link(text: str, wanted: set[str]) -> str:
    document = UrdfDocument(text)
    if taken := wanted & document.links:
        raise DescriptionError(
            'the URDF of the arm cannot be combined with the drone_file, because it already has a '
            f'link {", ".join(taken)}'
        )
    (base,) = document.links - {joint.child for joint in document.joints.values()}
    return base


def _add_body(root: ET.Element, name: str, drone: DroneConfig) -> None:
    link = ET.SubElement(root, 'link', name=name)
    inertial = ET.SubElement(link, 'inertial')
    _origin(inertial, drone.centre_of_mass)
    ET.SubElement(inertial, 'mass', value=repr(drone.mass))
    keys = ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')
    values = {key: repr(value) for key, value in zip(keys, drone.inertia, strict=True)}
    ET.SubElement(inertial, 'inertia', values)
    for kind in ('visual', 'collision'):
        shape = ET.SubElement(link, kind, name=f'drone_body_{kind}')
        ET.SubElement(ET.SubElement(shape, 'geometry'), 'box', size=numbers_text(drone.size))
        if kind == 'visual':
            ET.SubElement(shape, 'material', name='drone_body')
    for rotor in drone.rotors:
        place, axis = np.array(rotor.position), np.array(rotor.axis)
        _cylinder(link, f'{rotor.name}_disc', place, axis, _SPAN, 0.006, 'drone_rotor')
        root_of_arm = place * (0.0, 0.0, 1.0)
        length = float(np.linalg.norm(place - root_of_arm))
        if length > 0.0:
            middle, along = 0.5 * (place + root_of_arm), (place - root_of_arm) / length
            _cylinder(link, f'{rotor.name}_arm', middle, along, 0.01, length, 'drone_body')


def _cylinder(
    link: ET.Element,
    name: str,
    centre: np.ndarray,
    axis: np.ndarray,
    radius: float,
    length: float,
    material: str,
) -> None:
    shape = ET.SubElement(link, 'visual', name=name)
    # Roll and pitch that rotate z to the axis: R = Ry(pitch) Rx(roll).
    roll = float(np.arcsin(min(1.0, max(-1.0, -axis[1]))))
    pitch = float(np.arctan2(axis[0], axis[2]))
    _origin(shape, centre.tolist(), (roll, pitch, 0.0))
    sizes = {'radius': repr(radius), 'length': repr(length)}
    ET.SubElement(ET.SubElement(shape, 'geometry'), 'cylinder', sizes)
    ET.SubElement(shape, 'material', name=material)


def _fix(root: ET.Element, name: str, links: tuple[str, str], pose: PoseConfig) -> None:
    joint = ET.SubElement(root, 'joint', name=name, type='fixed')
    for end, link in zip(('parent', 'child'), links, strict=True):
        ET.SubElement(joint, end, link=link)
    _origin(joint, pose.position, pose.rpy)


def _origin(
    owner: ET.Element, xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)
) -> None:
    ET.SubElement(owner, 'origin', xyz=numbers_text(xyz), rpy=numbers_text(rpy))
