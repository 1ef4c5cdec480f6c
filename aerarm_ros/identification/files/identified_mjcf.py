"""The identified arm for MuJoCo: bodies, joints, friction and rotors, without shapes."""

import xml.etree.ElementTree as ET

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import barycentric_inertia

Array = npt.NDArray[np.float64]

_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of MuJoCo's fullinertia


def identified_mjcf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> str:
    """Return an MJCF text with the dynamics of the identified arm.

    Frames, names and directions are those of the URDF. Links behind fixed or locked joints are part
    of the one that carries them, as they were identified; what is fixed to the base has no
    effect and is left out. Angles are in radians, gravity as it was found.

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
    ET.SubElement(root, 'option', gravity=_numbers(robot.gravity_in_base))
    bodies = {0: ET.SubElement(root, 'worldbody')}
    centres = inertial[:, 1:4] / inertial[:, :1]
    tensors = barycentric_inertia(inertial)
    for index, (link, joint) in enumerate(zip(robot.link_names, robot.joint_names, strict=True)):
        number = robot.model.getJointId(joint)
        placement = robot.model.jointPlacements[number]
        quaternion = pin.Quaternion(placement.rotation).coeffs()
        body = ET.SubElement(
            bodies[robot.model.parents[number]],
            'body',
            name=link,
            pos=_numbers(placement.translation),
            quat=_numbers(np.roll(quaternion, 1)),
        )
        bodies[number] = body
        ET.SubElement(
            body,
            'inertial',
            pos=_numbers(centres[index]),
            mass=repr(float(inertial[index, 0])),
            fullinertia=_numbers([tensors[index][entry] for entry in _ENTRIES]),
        )
        attributes = {
            'name': joint,
            **_freedom(robot.model.joints[number]),
            'damping': repr(float(viscous[index])),
            'frictionloss': repr(float(coulomb[index])),
            'armature': repr(float(rotor_inertia[index])),
        }
        element = ET.SubElement(body, 'joint', attributes)
        low, high = robot.position_min[index], robot.position_max[index]
        if np.isfinite([low, high]).all():
            element.set('limited', 'true')
            element.set('range', _numbers([low, high]))
    ET.indent(root)
    return ET.tostring(root, encoding='unicode') + '\n'


def _freedom(joint: pin.JointModel) -> dict[str, str]:
    """Return type and axis of a joint, from its motion subspace."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    linear, angular = np.split(np.asarray(data.S).ravel(), 2)
    if angular.any():
        return {'type': 'hinge', 'axis': _numbers(angular)}
    return {'type': 'slide', 'axis': _numbers(linear)}


def _numbers(values: npt.ArrayLike) -> str:
    return ' '.join(repr(float(value)) for value in np.ravel(values))
