"""What any description of an arm says of a link: where it hangs, its body, how its joint moves."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import barycentric_inertia

Array = npt.NDArray[np.float64]

INERTIA_ENTRIES = {
    'xx': (0, 0),
    'yy': (1, 1),
    'zz': (2, 2),
    'xy': (0, 1),
    'xz': (0, 2),
    'yz': (1, 2),
}
"""Which entry of an inertia tensor each name stands for."""


@dataclass(frozen=True, eq=False)
class LinkBody:
    """A moving link of a serial arm, about the frame of its joint.

    Attributes
    ----------
    link, joint : str
    parent : int or None
        Index of the link that carries it; None for the base.
    translation : (3,) ndarray
        Of its frame in that of the parent [m].
    quaternion : (4,) ndarray
        Rotation of the same, x y z w.
    mass : float
        [kg]
    centre : (3,) ndarray
        Of mass [m].
    tensor : (3, 3) ndarray
        Inertia about the centre of mass, along the frame's axes [kg m^2].
    turns : bool
        Whether the joint is revolute; else prismatic.
    axis : (3,) ndarray
        Of the joint.
    limits : (2,) ndarray
        [rad] or [m]; infinite for a continuous joint.
    """

    link: str
    joint: str
    parent: int | None
    translation: Array
    quaternion: Array
    mass: float
    centre: Array
    tensor: Array
    turns: bool
    axis: Array
    limits: Array


def link_bodies(robot: Robot, inertial: Array) -> Iterator[LinkBody]:
    """Yield the moving links from base to tool.

    Links behind fixed or locked joints are part of the one that carries them, as they were
    identified; what is fixed to the base has no effect and is left out.

    Parameters
    ----------
    robot : Robot
    inertial : (n, 10) ndarray
        Of the moving links, thesis (3.3): of bodies that can be.
    """
    numbers = [robot.model.getJointId(joint) for joint in robot.joint_names]
    tensors = barycentric_inertia(inertial)
    for index, number in enumerate(numbers):
        placement = robot.model.jointPlacements[number]
        parent = robot.model.parents[number]
        turns, axis = _freedom(robot.model.joints[number])
        yield LinkBody(
            link=robot.link_names[index],
            joint=robot.joint_names[index],
            parent=numbers.index(parent) if parent else None,
            translation=np.array(placement.translation),
            quaternion=np.array(pin.Quaternion(placement.rotation).coeffs()),
            mass=float(inertial[index, 0]),
            centre=inertial[index, 1:4] / inertial[index, 0],
            tensor=tensors[index],
            turns=turns,
            axis=axis,
            limits=np.array([robot.position_min[index], robot.position_max[index]]),
        )


def _freedom(joint: pin.JointModel) -> tuple[bool, Array]:
    """Return whether a joint turns, and its axis, from its motion subspace."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    linear, angular = np.split(np.asarray(data.S).ravel(), 2)
    return bool(angular.any()), angular if angular.any() else linear


def numbers_text(values: npt.ArrayLike) -> str:
    """Return numbers as XML has them, to the last bit."""
    return ' '.join(repr(float(value)) for value in np.ravel(values))
