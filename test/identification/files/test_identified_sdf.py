"""What a reader of SDF makes of the file moves as the identified arm does."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.files.identified_robot import identified_sdf
from aerarm_ros.model.dynamics import Dynamics

ROTOR = '{drake.mit.edu}rotor_inertia'


def numbers(element: ET.Element, path: str) -> np.ndarray:
    return np.array(element.findtext(path).split(), dtype=float)


def pinocchio_model(text: str) -> pin.Model:
    """Return the model that the text describes, read by the words of the SDF specification."""
    root = ET.fromstring(text)
    assert root.get('version') == '1.9'
    model, joints = pin.Model(), {'world': 0}
    links = {link.get('name'): link for link in root.iterfind('model/link')}
    for joint in root.iterfind('model/joint'):
        child, parent = joint.findtext('child'), joint.findtext('parent')
        pose = links[child].find('pose')
        assert pose.get('rotation_format') == 'quat_xyzw'
        assert pose.get('relative_to', 'world') == parent
        placed = pin.XYZQUATToSE3(np.array(pose.text.split(), dtype=float))
        axis = numbers(joint, 'axis/xyz')
        slides = joint.get('type') == 'prismatic'
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        joints[child] = model.addJoint(joints[parent], kind(axis), placed, joint.get('name'))
        inertial = links[child].find('inertial')
        pose = numbers(inertial, 'pose')
        assert not pose[3:].any()
        entries = [float(inertial.findtext(f'inertia/i{e}')) for e in ('xx', 'xy', 'yy')]
        entries += [float(inertial.findtext(f'inertia/i{e}')) for e in ('xz', 'yz', 'zz')]
        tensor = pin.Symmetric3(np.array(entries))
        body = pin.Inertia(float(inertial.findtext('mass')), pose[:3], tensor.matrix())
        model.appendBodyToJoint(joints[child], body, pin.SE3.Identity())
    return model


@pytest.mark.parametrize('file', [None, 'ur10_robot.urdf', 'panda.urdf'])
def test_the_sdf_model_needs_the_same_torque(
    file: str | None, example_urdf: Callable[[str], Path]
) -> None:
    locked = ['panda_finger_joint1', 'panda_finger_joint2'] if file == 'panda.urdf' else []
    robot = load_robot(None if file is None else example_urdf(file), locked=locked)
    random = np.random.default_rng(0)
    inertial = robot.inertial_parameters * random.uniform(0.9, 1.1, (robot.n, 1))
    viscous, coulomb, rotor = random.uniform(0.1, 0.5, (3, robot.n))
    text = identified_sdf(robot, inertial, viscous, coulomb, rotor)
    model = pinocchio_model(text)
    model.gravity.linear = robot.gravity_in_base
    joints = ET.fromstring(text).findall('model/joint')
    assert [float(own.findtext('axis/dynamics/damping')) for own in joints] == viscous.tolist()
    assert [float(own.findtext('axis/dynamics/friction')) for own in joints] == coulomb.tolist()
    model.armature = np.array([float(own.findtext(ROTOR)) for own in joints])
    wanted, data = Dynamics(robot.with_inertial_parameters(inertial), rotor), model.createData()
    for _ in range(20):
        q, dq, ddq = random.uniform(-1.5, 1.5, (3, robot.n))
        torque = pin.rnea(model, data, q, dq, ddq)
        assert torque == pytest.approx(wanted.inverse(q, dq, ddq), abs=1e-9)


def test_limits_survive() -> None:
    robot = load_robot()
    nothing = np.zeros(robot.n)
    text = identified_sdf(robot, robot.inertial_parameters, nothing, nothing, nothing)
    for k, joint in enumerate(ET.fromstring(text).findall('model/joint')):
        assert joint.get('name') == robot.joint_names[k]
        bounded = np.isfinite(robot.position_max[k])
        assert joint.get('type') == ('revolute' if bounded else 'continuous')
        assert float(joint.findtext('axis/limit/lower', '-inf')) == robot.position_min[k]
        assert float(joint.findtext('axis/limit/upper', 'inf')) == robot.position_max[k]
        assert float(joint.findtext('axis/limit/velocity')) == robot.velocity_max[k]
