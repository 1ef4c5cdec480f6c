"""Simulators read the identified arm from URDF, MJCF and SDF."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.files.identified_robot import (
    LoadFriction,
    equivalent_friction,
    identified_mjcf,
    identified_sdf,
    identified_urdf,
)
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import from_pseudo_inertia, is_physically_consistent, pseudo_inertia

FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


def heavier(robot: Robot) -> np.ndarray:
    """Inertial parameters of other bodies: 20 % denser, shifted by a centimetre."""
    shift = np.eye(4)
    shift[:3, 3] = 0.01
    matter = 1.2 * shift @ pseudo_inertia(robot.inertial_parameters) @ shift.T
    return from_pseudo_inertia(matter)


def skeleton(text: str) -> list[tuple]:
    """Everything in a URDF but inertial values, damping and friction."""
    root = ET.fromstring(text)
    for link in root.findall('link'):
        for inertial in link.findall('inertial'):
            link.remove(inertial)
    for joint in root.findall('joint'):
        for dynamics in joint.findall('dynamics'):
            dynamics.attrib.pop('damping', None)
            dynamics.attrib.pop('friction', None)
            if not dynamics.attrib:
                joint.remove(dynamics)
    return [(element.tag, sorted(element.attrib.items())) for element in root.iter()]


def robot_of(name: str, example_urdf: Callable[[str], Path]) -> Robot:
    locked = FINGERS if name.startswith('panda') else ()
    return load_robot(None if name == 'aerarm' else example_urdf(name), locked=locked)


@pytest.mark.parametrize('name', ['aerarm', 'ur10_robot.urdf', 'panda.urdf'])
def test_round_trip(name: str, example_urdf: Callable[[str], Path]) -> None:
    robot = robot_of(name, example_urdf)
    locked = FINGERS if name.startswith('panda') else ()
    inertial = heavier(robot)
    fv, fs = np.linspace(0.1, 0.2, robot.n), np.linspace(0.3, 0.4, robot.n)
    load = np.linspace(0.0, 0.05, robot.n)
    beside = LoadFriction(load, 0.5 * fv, 0.5 * fs)
    written = identified_urdf(robot, inertial, fv, fs, beside)
    assert not written.warnings
    again = load_robot(written.text, locked=locked)
    assert np.array_equal(again.load_friction, load)
    loaded = load > 0.0
    assert np.array_equal(again.viscous, np.where(loaded, 0.5 * fv, fv))
    assert np.array_equal(again.coulomb, np.where(loaded, 0.5 * fs, fs))
    # Another identification that found none.
    none = identified_urdf(again, inertial, fv, fs)
    again = load_robot(none.text, locked=locked)
    assert not again.load_friction.any()
    scale = np.abs(inertial).max(axis=1, keepdims=True)
    assert np.allclose(again.inertial_parameters / scale, inertial / scale, atol=1e-12)
    assert np.array_equal(again.viscous, fv)
    assert np.array_equal(again.coulomb, fs)
    assert skeleton(none.text) == skeleton(robot.urdf_text)


def test_fixed_links_give_their_inertia_to_the_moving_one(robot: Robot) -> None:
    """A payload drawn on the tool becomes part of link 4's identified total."""
    payload = (
        '<link name="tool0"><inertial><origin xyz="0.02 0 0"/><mass value="0.2"/>'
        '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>'
    )
    loaded = load_robot(robot.urdf_text.replace('<link name="tool0"/>', payload))
    assert loaded.inertial_parameters[3, 0] == pytest.approx(0.329)
    written = identified_urdf(loaded, heavier(loaded), np.zeros(4), np.zeros(4))
    again = load_robot(written.text)
    assert np.allclose(again.inertial_parameters, heavier(loaded), atol=1e-14)
    assert written.text.count('<inertial>') == 4


def test_links_behind_locked_joints_stay_physical(
    robot: Robot, example_urdf: Callable[[str], Path]
) -> None:
    """Fingers heavier than all that was found become lighter; a middle link moves its followers."""
    panda = load_robot(example_urdf('panda.urdf'), locked=FINGERS)
    for arm, locked, scale, words in (
        (panda, FINGERS, 0.01, '(panda_leftfinger, panda_rightfinger) have'),
        (load_robot(robot.urdf_text, locked=('joint3',)), ('joint3',), 1.2, ''),
    ):
        inertial, none = scale * arm.inertial_parameters, np.zeros(arm.n)
        written = identified_urdf(arm, inertial, none, none)
        assert words in ''.join(written.warnings)
        assert bool(words) == bool(written.warnings)
        model = pin.buildModelFromXML(written.text)  # without anything locked
        bodies = np.array([body.toDynamicParameters() for body in model.inertias[1:]])
        assert np.all(is_physically_consistent(bodies))
        again = load_robot(written.text, locked=locked).inertial_parameters
        assert np.allclose(again, inertial, atol=1e-12)


def mujoco_torque(
    model: mujoco.MjModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
) -> np.ndarray:
    """Return the torque of MuJoCo's links and rotors; friction and limits are passive there."""
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qacc = q, dq, ddq
    model.dof_frictionloss[:], model.dof_damping[:], model.jnt_limited[:] = 0.0, 0.0, 0
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


DRAKE_ROTOR = '{drake.mit.edu}rotor_inertia'


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


@pytest.mark.parametrize('name', ['aerarm', 'ur10_robot.urdf', 'panda.urdf'])
def test_simulators_and_pinocchio_need_the_same_torque(
    name: str, example_urdf: Callable[[str], Path]
) -> None:
    robot = robot_of(name, example_urdf).with_gravity([0.3, -0.2, -9.8])
    random = np.random.default_rng(0)
    inertial = robot.inertial_parameters * random.uniform(0.9, 1.1, (robot.n, 1))
    values = viscous, coulomb, rotor = random.uniform(0.1, 0.5, (3, robot.n))
    engine = mujoco.MjModel.from_xml_string(identified_mjcf(robot, inertial, *values))
    names = [mujoco.mj_id2name(engine, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(engine.njnt)]
    assert tuple(names) == robot.joint_names
    assert engine.dof_damping == pytest.approx(viscous)
    assert engine.dof_frictionloss == pytest.approx(coulomb)
    assert engine.dof_armature == pytest.approx(rotor)
    text = identified_sdf(robot, inertial, *values)
    model = pinocchio_model(text)
    model.gravity.linear = robot.gravity_in_base
    joints = ET.fromstring(text).findall('model/joint')
    assert [float(own.findtext('axis/dynamics/damping')) for own in joints] == viscous.tolist()
    assert [float(own.findtext('axis/dynamics/friction')) for own in joints] == coulomb.tolist()
    model.armature = np.array([float(own.findtext(DRAKE_ROTOR)) for own in joints])
    dynamics, data = Dynamics(robot.with_inertial_parameters(inertial), rotor), model.createData()
    for motion in random.uniform(-1.5, 1.5, (20, 3, robot.n)):
        wanted = pytest.approx(dynamics.inverse(*motion), abs=1e-9)
        assert mujoco_torque(engine, *motion) == wanted
        assert pin.rnea(model, data, *motion) == wanted


def estimate_with(result: IdentificationResult, **coefficients: float) -> Estimate:
    robot = result.robot
    terms = (*THESIS_TERMS, ROTOR, JointTerm(TermKind.LOAD), JointTerm(TermKind.OFFSET))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    theta = result.cad.vector(model)
    for index, (_, term) in enumerate(model.joint_columns, start=40):
        theta[index] = coefficients.get(term.symbol, 0.0)
    return Estimate('test', model, theta)


def test_load_becomes_coulomb_friction(result: IdentificationResult) -> None:
    """Of the carrying joint 2 most; rotors and offsets are no friction."""
    plain = estimate_with(result, fv=0.1, fs=0.2, Ja=5.0, fo=3.0)
    viscous, coulomb = equivalent_friction(plain, result.identification)
    assert viscous == pytest.approx([0.1] * 4)
    assert coulomb == pytest.approx([0.2] * 4)
    loaded = estimate_with(result, fv=0.1, fs=0.2, fl=0.1)
    _, more = equivalent_friction(loaded, result.identification)
    bag = result.identification[0]
    load = np.abs(bag.links_torque(loaded.inertial.ravel())).mean(axis=0)
    assert np.argmax(more - coulomb) == np.argmax(load) == 1
    assert more[1] - coulomb[1] == pytest.approx(0.1 * load[1], rel=0.5)


def test_physically_impossible_parameters_are_reported(robot: Robot) -> None:
    inertial = robot.inertial_parameters.copy()
    inertial[2, 4] = -1.0
    written = identified_urdf(robot, inertial, np.zeros(4), np.zeros(4))
    assert 'link link3 is NOT PHYSICALLY CONSISTENT' in written.warnings[0]
