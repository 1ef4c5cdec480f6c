"""Export of the identified arm as URDF, MJCF and SDF."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
import pinocchio as pin
from scipy.linalg import eigh
from scipy.optimize import nnls

from aerarm_ros.description.robot import Robot
from aerarm_ros.description.urdf_document import (
    DAMPING_BESIDE_LOAD,
    FRICTION_BESIDE_LOAD,
    LOAD_FRICTION,
    numbers_text,
)
from aerarm_ros.identification.files.estimate_file import NO_FRICTION
from aerarm_ros.identification.joint_model import COUPLED, TermKind
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.inertia import barycentric_inertia, is_physically_consistent, pseudo_inertia
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import macros


def equivalent_friction(
    estimate: Estimate, bags: Sequence[SampleColumns], beside_load: bool = False
) -> tuple[Array, Array]:
    """Return coefficients f_v and f_s of thesis (2.6) that fit the friction of an estimate best.

    The coefficients are fitted to the motion of the bags by non-negative least squares. For
    joints with friction (2.6) only, the result equals the estimate's coefficients.

    Parameters
    ----------
    bags : sequence of SampleColumns
        Identification bags.
    beside_load : bool
        Whether to exclude load-dependent friction, for programs that support it separately. These
        programs smooth the sign of the velocity near rest, as `FrictionCompensation` does, so the
        coefficient of smooth Coulomb friction is used unchanged.

    Returns
    -------
    two (n,) ndarrays
        Coefficients [Nms/rad] and [Nm].
    """
    model = estimate.model
    left_out = {*NO_FRICTION, TermKind.LOAD} if beside_load else NO_FRICTION
    viscous, coulomb = estimate.joint_values('fv'), estimate.joint_values('fs')
    loads = [bag.links_torque(estimate.inertial.ravel()) for bag in bags]
    for joint in range(model.n):
        own = [
            (term, value)
            for term, value in model.coefficients(estimate.theta, joint)
            if term.kind not in left_out
        ]
        if all(
            term.kind in (TermKind.VISCOUS, TermKind.COULOMB) and (beside_load or not term.width)
            for term, _ in own
        ):
            continue
        velocity, torque = [], []
        for bag, load in zip(bags, loads, strict=True):
            dq, ddq = bag.samples.dq[:, joint], bag.samples.ddq[:, joint]
            parts = [value * term.basis(dq, ddq, np.abs(load[:, joint])) for term, value in own]
            velocity.append(dq)
            torque.append(np.sum(parts, axis=0))
        viscous[joint], coulomb[joint] = _nearest(np.concatenate(velocity), np.concatenate(torque))
    return viscous, coulomb


def unwritten(estimate: Estimate) -> tuple[str, ...]:
    """Return notes on terms of the estimate that URDF, MJCF and SDF files cannot store.

    Torque offsets are not noted, because the integral action of a controller compensates them.
    """
    names = estimate.model.columns[10 * estimate.model.n :]
    pairs = zip(names, estimate.model.joint_columns, strict=True)
    coupled = [name for name, (_, term) in pairs if term.kind in COUPLED]
    if not coupled:
        return ()
    return (
        f'{", ".join(coupled)} are only in estimate.yaml: URDF, MJCF and SDF cannot describe a '
        "torque caused by another joint's motion",
    )


def _nearest(dq: Array, torque: Array) -> tuple[float, float]:
    (viscous, coulomb), _ = nnls(np.column_stack([dq, np.sign(dq)]), torque)
    return float(viscous), float(coulomb)


# largest fraction of the possible subtraction, so that the remaining body has volume
_REMAINING = 0.9


@dataclass(frozen=True, eq=False)
class LoadFriction:
    """Friction coefficients of a joint, with a load-dependent part.

    Attributes
    ----------
    share : (n,) ndarray
        Dry friction per torque transmitted by the gear [-].
    viscous, coulomb : (n,) ndarray
        Load-independent viscous [Nms/rad] and Coulomb [Nm] friction.
    """

    share: Array
    viscous: Array
    coulomb: Array


@dataclass(frozen=True)
class IdentifiedUrdf:
    """URDF text of the identified arm, with notes for the user."""

    text: str
    warnings: tuple[str, ...]


def identified_urdf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, load: LoadFriction | None = None
) -> IdentifiedUrdf:
    """Return the URDF with identified inertial and friction values.

    The identified parameters of a link include all bodies attached by fixed joints. The moving
    link therefore gets the total, and the `<inertial>` elements of the attached links are
    removed. Links behind locked joints keep their inertial parameters, which are subtracted from
    the total. If the rest is physically impossible, the masses of the links behind locked joints
    are reduced until every link is physically consistent; the sum still equals the identified
    parameters.

    Parameters
    ----------
    robot : Robot
        Robot loaded from the original URDF.
    inertial : (n, 10) ndarray
        Parameters of the moving links, thesis (3.3).
    viscous, coulomb : (n,) ndarray
        Values of `<dynamics damping friction>` [Nms/rad], [Nm].
    load : LoadFriction, optional
        Friction with its load-dependent part, which programs of this package can read.
    """
    text = robot.urdf_text
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    links = {link.get('name'): link for link in root.findall('link')}
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    warnings = []
    full = pin.buildModelFromXML(text)
    bodies = [frame for frame in full.frames if frame.type == pin.FrameType.BODY]
    carriers = [_moving_ancestor(full, joint, robot.joint_names) for joint in range(full.njoints)]
    for index, name in enumerate(robot.link_names):
        number = full.getJointId(robot.joint_names[index])
        locked = [joint for joint, own in enumerate(carriers) if own == number != joint]
        fixed = [body.name for body in bodies if body.parentJoint == number and body.name != name]
        held = [body.name for body in bodies if body.parentJoint in locked]
        kept = _inertia_held(full, number, locked)
        share = _possible_share(inertial[index], kept)
        if share < 1.0:
            warnings += _scaled(links, held, share, name)
        own = inertial[index] - share * kept
        if not is_physically_consistent(own):
            warnings.append(
                f'identified.urdf: link {name} is NOT PHYSICALLY CONSISTENT (no body has these '
                'inertial parameters); do not simulate or control with this file'
            )
        for other in fixed:
            for inertial_element in links[other].findall('inertial'):
                links[other].remove(inertial_element)
        _set_inertial(links[name], own)
        values = {'damping': viscous[index], 'friction': coulomb[index]}
        if load is not None and load.share[index]:
            values[LOAD_FRICTION] = load.share[index]
            values[DAMPING_BESIDE_LOAD] = load.viscous[index]
            values[FRICTION_BESIDE_LOAD] = load.coulomb[index]
        _set_dynamics(joints[robot.joint_names[index]], values)
    # The serializer adds a blank before '/>', which would make every line differ from the
    # original file.
    written = ET.tostring(root, encoding='unicode').replace(' />', '/>')
    return IdentifiedUrdf(before_root(text) + written + '\n', tuple(warnings))


def before_root(text: str) -> str:
    """Return the XML declaration and the comments before the root element of a URDF."""
    starts: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *_: starts.append(parser.CurrentByteIndex)
    encoded = text.encode()
    parser.Parse(encoded, True)
    return encoded[: starts[0]].decode()


def _inertia_held(full: Any, carrier: int, locked: Sequence[int]) -> Array:
    """Return the total inertial parameters of bodies behind locked joints, in the link's frame."""
    data = full.createData()
    posture = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
    pin.forwardKinematics(full, data, posture)
    total = np.zeros(10)
    for body in locked:
        placed = data.oMi[carrier].actInv(data.oMi[body]).act(full.inertias[body])
        total += placed.toDynamicParameters()
    return total


def _moving_ancestor(full: Any, joint: int, moving: tuple[str, ...]) -> int:
    """Return the joint itself or the nearest moving joint towards the base; 0 without one."""
    while joint > 0 and full.names[joint] not in moving:
        joint = full.parents[joint]
    return joint


def _possible_share(whole: Array, kept: Array) -> float:
    """Return the largest s, at most 1, for which `whole - s kept` is a physically possible body."""
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
    """Scale masses and inertias of links in a URDF by `share`; return notes for the user."""
    for name in held:
        for element in (
            *links[name].iterfind('inertial/mass'),
            *links[name].iterfind('inertial/inertia'),
        ):
            for key, value in element.items():
                element.set(key, repr(share * float(value)))
    return [
        f'identified.urdf: the links behind locked joints ({", ".join(held)}) have '
        f'{100.0 * share:.3g} % of the mass that the URDF states, because {carrier} would '
        'otherwise not be physically consistent; check the inertia of the locked links in the '
        'URDF'
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


def _set_dynamics(joint: ET.Element, values: Mapping[str, float]) -> None:
    dynamics = joint.find('dynamics')
    if dynamics is None:
        dynamics = ET.SubElement(joint, 'dynamics')
    for key in (LOAD_FRICTION, DAMPING_BESIDE_LOAD, FRICTION_BESIDE_LOAD):
        dynamics.attrib.pop(key, None)  # entry of the original URDF
    for key, value in values.items():
        dynamics.set(key, repr(float(value)))


_MODELS = Path(__file__).parent / 'simulators.jinja'
# Row and column of each named entry of an inertia tensor, in the order of MJCF.
_ENTRIES = {'xx': (0, 0), 'yy': (1, 1), 'zz': (2, 2), 'xy': (0, 1), 'xz': (0, 2), 'yz': (1, 2)}
_LIMITS = ('lower', 'upper', 'effort', 'velocity')


def identified_mjcf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> str:
    """Return an MJCF text (for MuJoCo) with the dynamics of the identified arm.

    Frames, names and directions equal those of the URDF. Angles are in radians, and gravity is the
    identified one.

    Parameters
    ----------
    robot : Robot
        Robot with identified gravity.
    inertial : (n, 10) ndarray
        Physically possible parameters of the moving links, thesis (3.3).
    viscous, coulomb, rotor_inertia : (n,) ndarray
        Viscous [Nms/rad] and Coulomb [Nm] friction, and rotor inertia [kg m^2], at the joints.
    """
    links = _links(robot, inertial, viscous, coulomb, rotor_inertia)
    return _model_text('mjcf', robot, links)


def identified_sdf(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> str:
    """Return an SDF text with the dynamics of the identified arm on a fixed base.

    SDF has no element for rotor inertia. Rotor inertia is stored in an element that only Drake
    reads, with a gear ratio of 1. Gravity belongs to the world, so it is given in a comment.

    Parameters
    ----------
    robot, inertial, viscous, coulomb, rotor_inertia
        Same as in `identified_mjcf`.
    """
    links = _links(robot, inertial, viscous, coulomb, rotor_inertia)
    return _model_text('sdf', robot, links)


def _links(
    robot: Robot, inertial: Array, viscous: Array, coulomb: Array, rotor_inertia: Array
) -> Iterator[dict[str, Any]]:
    """Yield the moving links from base to tool, in the terms of the templates.

    Positions and the rotation x y z w are those of the joint's frame in the frame of the parent
    link; the centre of mass, the inertia about it and the axis are in the joint's frame.
    """
    numbers = [robot.model.getJointId(joint) for joint in robot.joint_names]
    ranges = zip(
        *(robot.position_min, robot.position_max, robot.effort_max, robot.velocity_max), strict=True
    )
    tensors = barycentric_inertia(inertial)
    for index, (number, limits) in enumerate(zip(numbers, ranges, strict=True)):
        placement, parent = robot.model.jointPlacements[number], robot.model.parents[number]
        turns, axis = _freedom(robot.model.joints[number])
        quaternion = np.array(pin.Quaternion(placement.rotation).coeffs())
        yield {
            'link': robot.link_names[index],
            'joint': robot.joint_names[index],
            'parent': robot.link_names[numbers.index(parent)] if parent else None,
            'translation': placement.translation,
            'xyzw': quaternion,
            'wxyz': np.roll(quaternion, 1),
            'mass': inertial[index, 0],
            'centre': inertial[index, 1:4] / inertial[index, 0],
            'entries': {name: tensors[index][entry] for name, entry in _ENTRIES.items()},
            'turns': turns,
            'axis': axis,
            'is_limited': bool(np.isfinite(limits[:2]).all()),
            'range': limits[:2],
            'limits': {k: x for k, x in zip(_LIMITS, limits, strict=True) if np.isfinite(x)},
            'viscous': viscous[index],
            'coulomb': coulomb[index],
            'rotor_inertia': rotor_inertia[index],
        }


def _freedom(joint: pin.JointModel) -> tuple[bool, Array]:
    """Return whether a joint is revolute, and the joint's axis, from the Pinocchio model."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    linear, angular = np.split(np.asarray(data.S).ravel(), 2)
    return bool(angular.any()), angular if angular.any() else linear


def _model_text(kind: str, robot: Robot, links: Iterator[dict[str, Any]]) -> str:
    """Return the text of a simulator's model, with the macro `kind` of the templates."""
    macro = getattr(macros(_MODELS), kind)
    text = macro(robot.model.name, robot.gravity_in_base, list(links), numbers_text)
    ET.register_namespace('drake', 'drake.mit.edu')
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    ET.indent(root)
    return ET.tostring(root, encoding='unicode') + '\n'
