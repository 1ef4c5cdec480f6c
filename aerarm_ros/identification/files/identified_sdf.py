"""The identified arm as SDF, for Gazebo and Drake: links, joints, friction, without shapes."""

import xml.etree.ElementTree as ET

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.files.link_body import (
    INERTIA_ENTRIES,
    LinkBody,
    link_bodies,
    numbers_text,
)

Array = npt.NDArray[np.float64]

_VERSION = '1.9'  # the first with quaternions
_DRAKE = 'drake.mit.edu'


def identified_sdf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> str:
    """Return an SDF text with the dynamics of the identified arm, its base fixed to the world.

    Frames, names and directions are those of the URDF, links those of `link_bodies`. SDF has no
    place for rotor inertia: Drake's own element holds it, with a gear ratio of 1, which others pass
    over. Gravity belongs to the world, and stands in a comment.

    Parameters
    ----------
    robot : Robot
        With gravity as identified.
    inertial : (n, 10) ndarray
        Of the moving links, thesis (3.3): of bodies that can be.
    viscous, coulomb, rotor_inertia : (n,) ndarray
        [Nms/rad], [Nm], [kg m^2]
    """
    ET.register_namespace('drake', _DRAKE)
    root = ET.Element('sdf', version=_VERSION)
    root.append(ET.Comment(f' gravity as found [m/s^2]: {numbers_text(robot.gravity_in_base)} '))
    model = ET.SubElement(root, 'model', name=robot.model.name)
    bodies = list(link_bodies(robot, inertial))
    efforts = zip(robot.effort_max, robot.velocity_max, strict=True)
    for index, (own, (effort, velocity)) in enumerate(zip(bodies, efforts, strict=True)):
        parent = None if own.parent is None else bodies[own.parent].link
        _add_link(model, own, parent)
        joint = _add_joint(model, own, parent or 'world')
        axis = ET.SubElement(joint, 'axis')
        _text(axis, 'xyz', own.axis)
        dynamics = ET.SubElement(axis, 'dynamics')
        _text(dynamics, 'damping', viscous[index])
        _text(dynamics, 'friction', coulomb[index])
        limit = ET.SubElement(axis, 'limit')
        known = zip(
            ('lower', 'upper', 'effort', 'velocity'), (*own.limits, effort, velocity), strict=True
        )
        for tag, value in known:
            if np.isfinite(value):
                _text(limit, tag, value)
        _text(joint, f'{{{_DRAKE}}}rotor_inertia', rotor_inertia[index])
        _text(joint, f'{{{_DRAKE}}}gear_ratio', 1.0)
    ET.indent(root)
    return ET.tostring(root, encoding='unicode') + '\n'


def _add_link(model: ET.Element, own: LinkBody, parent: str | None) -> None:
    link = ET.SubElement(model, 'link', name=own.link)
    pose = ET.SubElement(link, 'pose', rotation_format='quat_xyzw')
    if parent is not None:
        pose.set('relative_to', parent)
    pose.text = numbers_text([*own.translation, *own.quaternion])
    inertial = ET.SubElement(link, 'inertial')
    _text(inertial, 'pose', [*own.centre, 0.0, 0.0, 0.0])
    _text(inertial, 'mass', own.mass)
    inertia = ET.SubElement(inertial, 'inertia')
    for name, entry in INERTIA_ENTRIES.items():
        _text(inertia, f'i{name}', own.tensor[entry])


def _add_joint(model: ET.Element, own: LinkBody, parent: str) -> ET.Element:
    """Return a joint whose frame is that of its link."""
    kind = 'prismatic'
    if own.turns:
        kind = 'revolute' if np.isfinite(own.limits).all() else 'continuous'
    joint = ET.SubElement(model, 'joint', name=own.joint, type=kind)
    ET.SubElement(joint, 'parent').text = parent
    ET.SubElement(joint, 'child').text = own.link
    return joint


def _text(parent: ET.Element, tag: str, values: npt.ArrayLike) -> None:
    ET.SubElement(parent, tag).text = numbers_text(values)
