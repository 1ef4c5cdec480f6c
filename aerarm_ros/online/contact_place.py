"""Estimation of location and force of a contact from external joint torques."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array

_FELT = 0.8  # of its threshold, above which a joint's torque counts as external
_POINTS = 21  # points tested along a link
_CONDITION = 30.0  # condition number of the Jacobian up to which the force is determined


class ContactPlace(NamedTuple):
    """Contact force and contact point that explain the external joint torque.

    Attributes
    ----------
    link : str
        The touched link, or an earlier one if the force passes through the joint axes in between.
    point : (3,) ndarray
        Point of the contact on the line from the link's joint to its far end, in the joint's frame
        [m].
    point_in_base : (3,) ndarray
        Point of the contact in the frame of the base [m].
    force : (3,) ndarray
        Force on the arm, in the frame of the base [N]; the smallest one that explains the torque
        if the posture does not determine it.
    is_determined : bool
        Whether the contact acts on at least three joints and the posture determines all force
        axes.
    """

    link: str
    point: Array
    point_in_base: Array
    force: Array
    is_determined: bool


class ContactLocator:
    """Estimator of a contact's place and force; not thread-safe: use one instance per thread.

    A contact causes no torque in joints beyond the touched link. So the last joint with external
    torque belongs to that link (Haddadin, De Luca, Albu-Schaeffer: Robot collisions: a survey,
    IEEE T-RO 2017). The result is the point, on the line from the joint to the link's far end,
    whose force explains the torque best.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._model = robot.model
        self._data = robot.model.createData()
        self._ends = [_far_end(robot, joint) for joint in range(1, robot.n + 1)]

    def locate(self, q: Array, torque: Array, threshold: Array) -> ContactPlace | None:
        """Return link, point and force of a contact; None if no joint has external torque.

        Parameters
        ----------
        q : (n,) ndarray
            Posture of the arm [rad].
        torque, threshold : (n,) ndarray
            External torque, and the part that may be a model error [Nm].
        """
        felt = np.flatnonzero(np.abs(torque) > _FELT * threshold)
        if not len(felt) or not np.isfinite(threshold).all():
            return None
        last = int(felt[-1])
        pin.computeJointJacobians(self._model, self._data, q)
        at_joint = pin.getJointJacobian(self._model, self._data, last + 1, pin.LOCAL_WORLD_ALIGNED)[
            :, : last + 1
        ]
        rotation = self._data.oMi[last + 1].rotation
        weight = 1.0 / threshold[: last + 1]
        tried = [
            _explained(at_joint, rotation @ point, weight, torque[: last + 1])
            for point in np.linspace(0.0, 1.0, _POINTS)[:, np.newaxis] * self._ends[last]
        ]
        best = int(np.argmin([error for error, _, _ in tried]))
        _, force, condition = tried[best]
        point = self._ends[last] * best / (_POINTS - 1)
        is_determined = last >= 2 and condition < _CONDITION
        in_base = self._data.oMi[last + 1].act(point)
        link = self._robot.link_names[last]
        return ContactPlace(link, point, in_base, force, is_determined)


def _explained(
    at_joint: Array, offset: Array, weight: Array, torque: Array
) -> tuple[float, Array, float]:
    """Return torque error, force (3,) and condition number for a contact at a point of a link."""
    jacobian = at_joint[:3] - pin.skew(offset) @ at_joint[3:]
    rows = weight[:, np.newaxis] * jacobian.T
    force, _, _, sizes = np.linalg.lstsq(rows, weight * torque, rcond=0.02)
    error = float(np.linalg.norm(rows @ force - weight * torque))
    # A small cost of the force selects, of two equal places, the one with the smaller force.
    error += 1e-3 * float(np.linalg.norm(weight * torque)) * float(np.linalg.norm(force))
    condition = float(sizes[0] / max(sizes[-1], 1e-12)) if len(sizes) == 3 else np.inf
    return error, force, condition


def _far_end(robot: Robot, joint: int) -> Array:
    """Return the farthest frame or joint (3,) on a link, in the frame of the link's joint [m]."""
    model = robot.model
    places = [
        np.array(frame.placement.translation)
        for frame in model.frames
        if frame.parentJoint == joint
    ]
    places += [
        np.array(model.jointPlacements[child].translation)
        for child in range(1, model.njoints)
        if model.parents[child] == joint
    ]
    return max(places, key=lambda place: float(np.linalg.norm(place)), default=np.zeros(3))
