"""The identified arm for MuJoCo: bodies, joints, friction and rotors, without shapes."""

import xml.etree.ElementTree as ET

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.files.link_body import INERTIA_ENTRIES, link_bodies, numbers_text

Array = npt.NDArray[np.float64]


def identified_mjcf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> str:
    """Return an MJCF text with the dynamics of the identified arm.

    Frames, names and directions are those of the URDF, links those of `link_bodies`. Angles are in
    radians, gravity as it was found.

    Parameters
    ----------
    robot : Robot
        With gravity as identified.
    inertial : (n, 10) ndarray
        Of the moving links, thesis (3.3): of bodies that can be.
    viscous, coulomb, rotor_inertia : (n,) ndarray
        MuJoCo's damping, frictionloss and armature [Nms/rad], [Nm], [kg m^2].
    """
    root = ET.Element('mujoco', model=robot.model.name)
    ET.SubElement(root, 'compiler', angle='radian', balanceinertia='false', boundmass='0')
    ET.SubElement(root, 'option', gravity=numbers_text(robot.gravity_in_base))
    world = ET.SubElement(root, 'worldbody')
    bodies: list[ET.Element] = []
    for index, own in enumerate(link_bodies(robot, inertial)):
        body = ET.SubElement(
            world if own.parent is None else bodies[own.parent],
            'body',
            name=own.link,
            pos=numbers_text(own.translation),
            quat=numbers_text(np.roll(own.quaternion, 1)),
        )
        bodies.append(body)
        ET.SubElement(
            body,
            'inertial',
            pos=numbers_text(own.centre),
            mass=repr(own.mass),
            fullinertia=numbers_text([own.tensor[entry] for entry in INERTIA_ENTRIES.values()]),
        )
        attributes = {
            'name': own.joint,
            'type': 'hinge' if own.turns else 'slide',
            'axis': numbers_text(own.axis),
            'damping': repr(float(viscous[index])),
            'frictionloss': repr(float(coulomb[index])),
            'armature': repr(float(rotor_inertia[index])),
        }
        joint = ET.SubElement(body, 'joint', attributes)
        if np.isfinite(own.limits).all():
            joint.set('limited', 'true')
            joint.set('range', numbers_text(own.limits))
    ET.indent(root)
    return ET.tostring(root, encoding='unicode') + '\n'
