"""Serial arm described by its URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.config_reader import DescriptionError, check_prefix
from aerarm_ros.description.resources import find_file, resource
from aerarm_ros.description.urdf_document import LARGEST, UrdfDocument, UrdfJoint
from aerarm_ros.motion.signals import Array

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class Robot:
    """Serial arm on a fixed base, with n joints of one degree of freedom each.

    Links behind fixed (or locked) joints belong to the link that carries them. Use `load_robot` to
    create a robot.

    Attributes
    ----------
    model : pinocchio.Model
        Pinocchio model with `gravity` set, and without rotor inertia (`armature`). The model is
        shared by all users of this robot; copy it before changing it.
    joints : tuple of UrdfJoint
        Moving joints, from base to tool.
    urdf_text : str
        URDF text, with the prefix added to its names.
    path : Path or None
        Path of the URDF; None if it was given as text.
    prefix : str
        Prefix added to the names of links and joints in the file.
    """

    model: Any
    joints: tuple[UrdfJoint, ...]
    urdf_text: str
    path: Path | None = None
    prefix: str = ''

    @property
    def n(self) -> int:
        """Number of moving joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints, from base to tool."""
        return tuple(joint.name for joint in self.joints)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the moving links, from base to tool; a link's frame is that of its joint."""
        return tuple(joint.child for joint in self.joints)

    @cached_property
    def base_link(self) -> str:
        """Name of the root link, whose frame is the base frame."""
        bodies = (f for f in self.model.frames if f.type == pin.FrameType.BODY)
        return str(next(bodies).name)

    @cached_property
    def end_link(self) -> str:
        """Name of the tool's link: tool0, or the last link of a URDF without tool0."""
        names = [str(f.name) for f in self.model.frames if f.type == pin.FrameType.BODY]
        tool = self.full_name('tool0')
        return tool if tool in names else names[-1]

    def full_name(self, name: str) -> str:
        """Return the name with prefix of a link or joint; `name` may lack the prefix."""
        full = self.prefix + name
        return full if self.model.existFrame(full) else name

    def frame_of(self, link: str) -> Any:
        """Return the pinocchio.Frame of a link; the name `link` may lack the prefix.

        Raises
        ------
        ValueError
            If the link is unknown.
        """
        links = [f.name for f in self.model.frames if f.type == pin.FrameType.BODY]
        name = self.full_name(link)
        if name not in links:
            raise ValueError(f'unknown link {name!r}: choose one of {", ".join(links)}')
        return self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]

    def own_name(self, name: str) -> str:
        """Return the name of a link or joint without prefix, as in the arm's files."""
        return name.removeprefix(self.prefix)

    @cached_property
    def position_min(self) -> Array:
        """Lower position limits (n,) [rad] (prismatic: [m]); -inf for a continuous joint."""
        return _frozen(self.model.lowerPositionLimit)

    @cached_property
    def position_max(self) -> Array:
        """Upper position limits (n,) [rad] (prismatic: [m]); inf for a continuous joint."""
        return _frozen(self.model.upperPositionLimit)

    @cached_property
    def posture_range(self) -> tuple[Array, Array]:
        """Range (n,) of random postures [rad]: the position limits, or one turn without limits."""
        low, high = self.position_min, self.position_max
        return (
            _frozen(np.where(np.isfinite(low), low, -np.pi)),
            _frozen(np.where(np.isfinite(high), high, np.pi)),
        )

    @cached_property
    def velocity_max(self) -> Array:
        """Velocity limits (n,) [rad/s]; inf if missing in the URDF."""
        return _frozen(self.model.velocityLimit)

    @cached_property
    def effort_max(self) -> Array:
        """Effort limits (n,) [Nm]; inf if missing in the URDF."""
        return _frozen(self.model.effortLimit)

    @cached_property
    def viscous(self) -> Array:
        """Viscous friction f_v (n,) [Nms/rad] from `<dynamics damping>`."""
        return _frozen([joint.damping for joint in self.joints])

    @cached_property
    def coulomb(self) -> Array:
        """Coulomb friction f_s (n,) [Nm] from `<dynamics friction>`."""
        return _frozen([joint.friction for joint in self.joints])

    @cached_property
    def load_friction(self) -> Array:
        """Dry friction (n,) per torque that the gear transmits, from `<dynamics load_friction>`."""
        return _frozen([joint.load_friction for joint in self.joints])

    @cached_property
    def gravity_in_base(self) -> Array:
        """Gravity (3,) in the base frame [m/s^2]."""
        return _frozen(self.model.gravity.linear)

    @cached_property
    def inertial_parameters(self) -> Array:
        """Inertial parameters (n, 10) of the moving links, in the order of thesis (3.3)."""
        bodies = [self.model.inertias[i + 1] for i in range(self.n)]
        return _frozen([body.toDynamicParameters() for body in bodies])

    def with_inertial_parameters(self, pi: npt.ArrayLike) -> Robot:
        """Return a copy of the robot whose moving links have the inertial parameters `pi`.

        The attribute `urdf_text` keeps the original text.

        Parameters
        ----------
        pi : (n, 10) array_like
            Inertial parameters, in the order of thesis (3.3). The parameters may be physically
            inconsistent, but every mass must be nonzero, because a body is stored by its centre of
            mass.

        Raises
        ------
        ValueError
            If the shape is wrong, a value is not finite or a mass is zero.
        """
        pi = np.array(pi, dtype=float)
        if pi.shape != (self.n, 10):
            raise ValueError(
                f'inertial parameters have the shape {pi.shape} instead of {(self.n, 10)}'
            )
        if not np.all(np.isfinite(pi)) or np.any(pi[:, 0] == 0.0):
            raise ValueError('inertial parameters must be finite, and masses must not be zero')
        model = self.model.copy()
        for index, parameters in enumerate(pi):
            model.inertias[index + 1] = pin.Inertia.FromDynamicParameters(parameters)
        return replace(self, model=model)

    def with_gravity(self, gravity_in_base: npt.ArrayLike) -> Robot:
        """Return a copy of the robot with another gravity vector (3,) in the base frame [m/s^2]."""
        model = self.model.copy()
        model.gravity.linear = _gravity(gravity_in_base)
        return replace(self, model=model)


def load_robot(
    urdf: Path | str | None = None,
    *,
    gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY,
    joint_names: Sequence[str] | None = None,
    locked: Sequence[str] = (),
    prefix: str = '',
) -> Robot:
    """Read a serial arm from a URDF without loading its meshes.

    Continuous joints are represented by their angle [rad], like revolute ones, without position
    limits. Prismatic joints are supported, with [m] in place of [rad] and [N] in place of [Nm].

    Parameters
    ----------
    urdf : Path or str, optional
        URDF file, or URDF text if it starts with `<`. Default: this package's arm.
    gravity_in_base : (3,) array_like
        Gravity in the base frame [m/s^2].
    joint_names : sequence of str, optional
        Moving joints, from base to tool; all others are locked at zero.
    locked : sequence of str
        Joints locked at zero, or at their limit nearest to zero if zero is outside their range;
        for example gripper fingers.
    prefix : str
        Prefix added to the name of every link and joint. `joint_names` and `locked` have no prefix.

    Raises
    ------
    DescriptionError
        If the file cannot be read or is not a URDF, or a named joint is missing or out of order.
        Also if the moving joints do not form one chain, if a joint mimics another, has more than
        one degree of freedom or carries no inertia, or if the prefix is invalid.
    """
    check_prefix(prefix)
    text, path = read_urdf(urdf)
    source = 'the URDF text' if path is None else str(path)
    try:
        document = UrdfDocument(text)
        if prefix:
            text = document.prefixed_text(prefix)
            document = UrdfDocument(text)
            locked = [prefix + name for name in locked]
            joint_names = joint_names and [prefix + name for name in joint_names]
        moving = _moving_joints(document, joint_names, locked)
        model = _build_model(document, moving)
        _check_model(model, moving, is_ordered=joint_names is not None)
    except DescriptionError as error:
        raise DescriptionError(f'{source}: {error}') from None
    model.gravity.linear = _gravity(gravity_in_base)
    joints = tuple(document.joints[name] for name in model.names[1:])
    return Robot(model, joints, text, path, prefix)


def read_urdf(urdf: Path | str | None) -> tuple[str, Path | None]:
    """Return text and path of a URDF: a file, the packaged URDF (None), or a text (path None).

    Raises
    ------
    DescriptionError
        If the file cannot be read.
    """
    if isinstance(urdf, str) and urdf.lstrip().startswith('<'):
        return urdf.lstrip(), None
    path = resource('urdf', 'aerarm.urdf') if urdf is None else find_file(urdf)
    try:
        with path.open('rb') as stream:
            return stream.read(LARGEST + 1).decode(), path
    except OSError as error:
        reason = error.strerror or str(error)
        raise DescriptionError(
            f'{path} cannot be read ({reason}): check the path and its permissions'
        ) from None
    except UnicodeDecodeError:
        raise DescriptionError(
            f'{path} is not a text file, so it cannot be a URDF: check the path'
        ) from None


def _moving_joints(
    document: UrdfDocument, joint_names: Sequence[str] | None, locked: Sequence[str]
) -> list[UrdfJoint]:
    """Return the moving joints of the URDF, in the order of `joint_names` if given."""
    driven = {name: joint for name, joint in document.joints.items() if joint.is_driven}
    for name in (*locked, *(joint_names or ())):
        if name not in driven:
            known = ', '.join(driven) or 'none'
            raise DescriptionError(
                f'unknown moving joint {name!r}: the moving joints of the URDF are {known}'
            )
    wanted = list(driven) if joint_names is None else list(joint_names)
    moving = [document.joints[name] for name in wanted if name not in locked]
    if not moving:
        raise DescriptionError('no joint can move: at least one moving joint must not be locked')
    for joint in moving:
        if joint.mimics is not None:
            raise DescriptionError(
                f'joint {joint.name} mimics {joint.mimics}, which is not supported: lock it'
            )
    for joint in document.joints.values():
        if joint.kind in ('floating', 'planar'):
            raise DescriptionError(
                f'joint {joint.name} is {joint.kind}, but only joints of one degree of freedom '
                'are supported: lock it'
            )
    return moving


def _build_model(document: UrdfDocument, moving: list[UrdfJoint]) -> Any:
    try:
        model = pin.buildModelFromXML(document.revolute_text())
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(f'not a valid URDF ({error})') from None
    names = {joint.name for joint in moving}
    locked = [index for index in range(1, model.njoints) if model.names[index] not in names]
    if locked:
        posture = np.clip(0.0, model.lowerPositionLimit, model.upperPositionLimit)
        model = pin.buildReducedModel(model, locked, posture)
    _free_unlimited(model, document)
    return model


def _free_unlimited(model: Any, document: UrdfDocument) -> None:
    """Set limits that are missing in the URDF to infinity."""
    for index, name in enumerate(model.names[1:]):
        joint = document.joints[name]
        if joint.kind == 'continuous':
            model.lowerPositionLimit[index] = -np.inf
            model.upperPositionLimit[index] = np.inf
        if not joint.has_limit:
            model.velocityLimit[index] = np.inf
            model.effortLimit[index] = np.inf


def _check_model(model: Any, moving: list[UrdfJoint], is_ordered: bool) -> None:
    names = list(model.names[1:])
    for index in range(1, model.njoints):
        if model.parents[index] != index - 1:
            raise DescriptionError(
                f'not a serial arm: joint {model.names[index]} does not follow joint '
                f'{model.names[index - 1]}; lock the joints of side branches'
            )
    requested = [joint.name for joint in moving]
    if sorted(requested) != sorted(names):
        raise DescriptionError(
            f'joints {requested} do not form one chain from the base: the joints of the chain are '
            f'{names}'
        )
    if is_ordered and requested != names:
        raise DescriptionError(
            f'joint_names must be in the order from base to tool: {", ".join(names)}'
        )
    children = {joint.name: joint.child for joint in moving}
    for index, name in enumerate(names, start=1):
        if model.inertias[index].mass <= 0.0:
            raise DescriptionError(
                f'link {children[name]} (moved by joint {name}) has no mass: give it an '
                '<inertial>, or lock the joint'
            )


def _gravity(gravity_in_base: npt.ArrayLike) -> Array:
    gravity = np.array(gravity_in_base, dtype=float)
    if gravity.shape != (3,) or not np.all(np.isfinite(gravity)):
        raise DescriptionError(f'gravity_in_base = {gravity} must be three numbers [m/s^2]')
    return gravity


def _frozen(values: npt.ArrayLike) -> Array:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
