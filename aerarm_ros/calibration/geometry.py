"""Geometric errors of an arm, and the effect of these errors on the pose of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array

KINDS = ('offset', 'x', 'y', 'z', 'rx', 'ry', 'rz', 'compliance')
"""Kinds of geometric errors of a joint, in the order in which the calibration adds them.

offset
    Added to the recorded position [rad], of a prismatic joint [m].
x, y, z, rx, ry, rz
    Displacement [m] and rotation vector [rad] of the joint's frame, in its frame in the URDF.
compliance
    Deflection under the torque of gravity [rad/Nm].
"""
LINK_GEOMETRY = ('x', 'y', 'z', 'rx', 'ry', 'rz')


@dataclass(frozen=True)
class Tolerance:
    """Expected standard deviations of an arm's geometry from the geometry in its URDF.

    Attributes
    ----------
    length : float
        Displacement of a joint's frame per axis, and offset of a prismatic joint [m].
    angle : float
        Rotation of a joint's frame per axis [rad]. Joint offsets, and deflections under the
        largest gravity torque of a joint, are typically twice as large.
    """

    length: float = 2e-3
    angle: float = 0.01

    def __post_init__(self) -> None:
        """Validate both values.

        Raises
        ------
        ValueError
            If a value is not positive and finite.
        """
        if not (0.0 < self.length < np.inf and 0.0 < self.angle < np.inf):
            raise ValueError(
                f'tolerances {self.length:g} m and {self.angle:g} rad must be positive and finite'
            )


_LEAST_TORQUE = 1e-3  # [Nm], [N] smallest gravity torque of a joint that limits its compliance
_POSTURES = 200  # number of random postures in which the largest gravity torque is searched


@dataclass(frozen=True, eq=False)
class LinkPoses:
    """Poses of a link in the base frame, with derivatives with respect to the geometric errors.

    Attributes
    ----------
    position : (M, 3) ndarray
        Position of the frame [m].
    jacobian : (M, 6, P) ndarray
        Derivatives of the frame's position (rows 0-2) and orientation (rows 3-5) with respect to
        each error, in base axes; columns in the order of `ArmGeometry.names`.
    """

    rotation: Array
    position: Array
    jacobian: Array


class ArmGeometry:
    """Kinematic chain from the base to a link, with geometric errors.

    The pose of the link is ``M_1 E_1 J_1(p_1) ... M_k E_k J_k(p_k)``, with the joint placements
    ``M`` of the URDF, the errors ``E`` (displacement and rotation of a joint's frame), and the
    joint transformations ``J`` at the true joint positions ``p = q + offset - compliance g(q)``,
    where ``g`` is the joint's gravity torque computed with the URDF's masses. Derivatives come
    from Pinocchio's kinematic regressor, which has a column for every displacement of every joint.

    Parameters
    ----------
    robot : Robot
        Nominal robot model.
    link : str
        Link to which the observations are attached.
    tolerance : Tolerance, optional
        Typical errors of manufacture and assembly.

    Attributes
    ----------
    link : str
        Full name of the link.
    names : tuple of P str
        Error names, for example 'joint2.offset', joint by joint, kinds in the order of `KINDS`.
    typical : (P,) ndarray
        Typical size of each error [rad], [m], [rad/Nm]: standard deviation of its prior.

    Raises
    ------
    ValueError
        If the link is unknown, or no joint moves it.
    """

    def __init__(self, robot: Robot, link: str, tolerance: Tolerance | None = None) -> None:
        frame = robot.frame_of(link)
        self.robot = robot
        self.link = str(frame.name)
        self._count = int(frame.parentJoint)
        if self._count == 0:
            raise ValueError(
                f'no joint moves link {link}: name the link that carries the markers, such as '
                f'{robot.link_names[-1]}'
            )
        self._placement = frame.placement
        self._subspaces = [_subspace(robot.model, i + 1) for i in range(self._count)]
        self.joint_names = robot.joint_names[: self._count]
        self.names = tuple(f'{joint}.{kind}' for joint in self.joint_names for kind in KINDS)
        self.typical = self._typical(tolerance or Tolerance())
        self._latest: tuple[Any, LinkPoses] | None = None

    @property
    def n(self) -> int:
        """Number of joints that move the link."""
        return self._count

    def is_prismatic(self, joint: int) -> bool:
        """Return whether the joint with this number (from 0) is prismatic."""
        return bool(np.any(self._subspaces[joint][:3]))

    def _typical(self, tolerance: Tolerance) -> Array:
        low, high = self.robot.posture_range
        q = np.random.default_rng(0).uniform(low, high, (_POSTURES, self.robot.n))
        torque = np.abs(self.gravity_torque(q)).max(axis=0)
        typical = []
        for joint in range(self._count):
            offset = tolerance.length if self.is_prismatic(joint) else 2.0 * tolerance.angle
            # A heavily loaded joint has a stiffer gear, so its deflection is similar.
            own = {'offset': offset, 'compliance': offset / max(torque[joint], _LEAST_TORQUE)}
            own |= dict.fromkeys('xyz', tolerance.length)
            typical += [own.get(kind, tolerance.angle) for kind in KINDS]
        return np.array(typical)

    def columns(self, *kinds: str) -> list[int]:
        """Return the indices in `names` of all errors of the given kinds."""
        return [k for k, name in enumerate(self.names) if name.rpartition('.')[2] in kinds]

    def unit(self, column: int) -> str:
        """Return the unit of a geometric error."""
        joint, kind = divmod(column, len(KINDS))
        if KINDS[kind] == 'compliance':
            return 'm/N' if self.is_prismatic(joint) else 'rad/Nm'
        if KINDS[kind] in 'xyz' or (KINDS[kind] == 'offset' and self.is_prismatic(joint)):
            return 'm'
        return 'rad'

    def _true_positions(self, q: Array, errors: Array, torque: Array) -> Array:
        """Return the true joint positions (M, n): recorded positions plus the joints' errors."""
        offset, *_, compliance = errors.reshape(self._count, len(KINDS)).T
        true = np.array(q, dtype=float)
        true[:, : self._count] += offset - compliance * torque[:, : self._count]
        return true

    def gravity_torque(self, q: Array) -> Array:
        """Return the gravity torques (M, n) at the joints of the nominal arm [Nm]."""
        model = self.robot.model
        data = model.createData()
        return np.array([pin.computeGeneralizedGravity(model, data, row).copy() for row in q])

    def poses(self, q: Array, errors: Array) -> LinkPoses:
        """Return the link's poses for joint positions and errors, with derivatives.

        The result of the latest call is kept: a solver requests residuals, then derivatives.

        Parameters
        ----------
        q : (M, n) ndarray
            Recorded joint positions of the robot [rad].
        """
        key = q.shape, q.tobytes(), errors.tobytes()
        if self._latest is None or self._latest[0] != key:
            self._latest = key, self._computed(q, errors)
        return self._latest[1]

    def _computed(self, q: Array, errors: Array) -> LinkPoses:
        model, inner = self.placed(errors)
        data = model.createData()
        count = self._count
        torque = self.gravity_torque(q)
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        regressor = np.empty((len(q), 6, 6 * count))
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        for row, true in enumerate(self._true_positions(q, errors, torque)):
            pin.forwardKinematics(model, data, true)
            pose = data.oMi[count] * self._placement
            rotation[row], position[row] = pose.rotation, pose.translation
            regressor[row] = pin.computeJointKinematicRegressor(
                model, data, count, frame, self._placement
            )[:, : 6 * count]
        return LinkPoses(rotation, position, self._jacobian(q, torque, regressor, inner))

    def placed(self, errors: Array) -> tuple[Any, list[Array]]:
        """Return a pinocchio.Model with displaced joints, and a (6, 6) derivative per joint."""
        model = self.robot.model.copy()
        inner = []
        for i, value in enumerate(errors.reshape(self._count, len(KINDS))):
            error = error_transform(value)
            model.jointPlacements[i + 1] = model.jointPlacements[i + 1] * error
            derivative = np.zeros((6, 6))
            derivative[:3, :3] = error.rotation.T
            derivative[3:, 3:] = pin.Jexp3(value[4:7])
            inner.append(derivative)
        return model, inner

    def _jacobian(self, q: Array, torque: Array, regressor: Array, inner: list[Array]) -> Array:
        jacobian = np.zeros((len(q), 6, len(self.names)))
        for i in range(self._count):
            local = regressor[:, :, 6 * i : 6 * i + 6]
            start = i * len(KINDS)
            along = local @ self._subspaces[i]
            jacobian[:, :, start] = along
            jacobian[:, :, start + 1 : start + 7] = local @ inner[i]
            jacobian[:, :, start + 7] = along * -torque[:, i, None]
        return jacobian


def error_transform(value: Array) -> Any:
    """Return the displacement of a joint's frame (pinocchio.SE3) due to the errors (8,)."""
    return pin.SE3(pin.exp3(np.array(value[4:7])), np.array(value[1:4]))


def _subspace(model: Any, joint: int) -> Array:
    """Return the motion axis (6,) of a joint with one degree of freedom, in the joint's frame."""
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, np.zeros(model.nq), np.zeros(model.nv))
    return np.array(data.S).reshape(6, -1)[:, 0]
