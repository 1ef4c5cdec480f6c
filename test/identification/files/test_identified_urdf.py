"""identified.urdf reloads with the identified values and is otherwise the same."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.files.identified_robot import LoadFriction, identified_urdf
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


@pytest.mark.parametrize('name', ['aerarm', 'ur10_robot.urdf', 'panda.urdf'])
def test_round_trip(name: str, example_urdf: Callable[[str], Path]) -> None:
    path = None if name == 'aerarm' else example_urdf(name)
    locked = FINGERS if name.startswith('panda') else ()
    robot = load_robot(path, locked=locked)
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


def test_comments_and_declaration_are_kept(robot: Robot) -> None:
    written = identified_urdf(robot, heavier(robot), np.zeros(4), np.zeros(4))
    assert written.text.startswith(robot.urdf_text.split('<robot')[0])
    comments = re.findall(r'<!--.*?-->', robot.urdf_text, flags=re.DOTALL)
    assert all(comment in written.text for comment in comments)


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


def bodies(text: str) -> np.ndarray:
    """Inertial parameters of every moving body, without anything locked."""
    model = pin.buildModelFromXML(text)
    return np.array([body.toDynamicParameters() for body in model.inertias[1:]])


def test_too_light_a_total_behind_locked_joints_stays_physical(
    example_urdf: Callable[[str], Path],
) -> None:
    """The fingers of the drawing are heavier than all that was found: they become lighter."""
    robot = load_robot(example_urdf('panda.urdf'), locked=FINGERS)
    inertial = robot.inertial_parameters * 0.01
    written = identified_urdf(robot, inertial, np.zeros(7), np.zeros(7))
    assert '(panda_leftfinger, panda_rightfinger) have' in written.warnings[0]
    assert np.all(is_physically_consistent(bodies(written.text)))
    again = load_robot(written.text, locked=FINGERS).inertial_parameters
    assert np.allclose(again, inertial, atol=1e-12)


def test_a_joint_locked_in_the_middle_of_the_chain(robot: Robot) -> None:
    """Links behind it that do move are not what it carries."""
    stiff = load_robot(robot.urdf_text, locked=('joint3',))
    inertial = 1.2 * stiff.inertial_parameters
    written = identified_urdf(stiff, inertial, np.zeros(3), np.zeros(3))
    assert not written.warnings
    assert np.all(is_physically_consistent(bodies(written.text)))
    again = load_robot(written.text, locked=('joint3',)).inertial_parameters
    assert np.allclose(again, inertial, atol=1e-12)


def test_physically_impossible_parameters_are_reported(robot: Robot) -> None:
    inertial = robot.inertial_parameters.copy()
    inertial[2, 4] = -1.0
    written = identified_urdf(robot, inertial, np.zeros(4), np.zeros(4))
    assert 'link link3 is NOT PHYSICALLY CONSISTENT' in written.warnings[0]


def test_mujoco_loads_it(robot: Robot) -> None:
    written = identified_urdf(robot, heavier(robot), np.full(4, 0.05), np.full(4, 0.2))
    model = mujoco.MjModel.from_xml_string(written.text)
    assert model.body_mass.sum() == pytest.approx(1.2 * robot.inertial_parameters[:, 0].sum())
    assert model.dof_damping == pytest.approx([0.05] * 4)
    assert model.dof_frictionloss == pytest.approx([0.2] * 4)


def test_mujoco_loads_meshes_of_packages(example_urdf: Callable[[str], Path]) -> None:
    """With the extension that docs/reference/files.md names; pinocchio doesn't mind it."""
    path = example_urdf('ur10_robot.urdf')
    robot = load_robot(path)
    text = identified_urdf(robot, heavier(robot), np.zeros(6), np.zeros(6)).text
    folder = path.parents[1] / 'meshes' / 'ur10' / 'collision'
    extension = (
        f'<mujoco><compiler discardvisual="true" strippath="true" meshdir="{folder}"/></mujoco>'
    )
    extended = text.replace('</robot>', f'{extension}</robot>')
    model = mujoco.MjModel.from_xml_string(extended)
    assert model.nv == 6
    wanted, read = heavier(robot), load_robot(extended).inertial_parameters
    assert np.allclose(read, wanted, atol=1e-9 * np.abs(wanted).max())
