"""Effect of errors of the arm's geometry on predicted torques."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.description.urdf_document import CALIBRATED
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.motion.signals import Array

MILLIMETRE = 1e-3  # [m]
_MOST = 300  # largest number of samples used


def is_calibrated(robot: Robot) -> bool:
    """Return whether the calibrator has written the URDF of a robot."""
    return CALIBRATED in robot.urdf_text


def torque_error_per_length(
    robot: Robot, q: Array, dq: Array, ddq: Array, length: float = MILLIMETRE
) -> float:
    """Return the relative torque error [%] caused by displaced joints.

    Each joint except the first is displaced by `length` along each axis of its parent link. The
    errors are independent, so their squares add up. The inertial parameters stay unchanged,
    although an identification would absorb a part of the error.

    Parameters
    ----------
    q, dq, ddq : (M, n) ndarray
        Joint motion [rad], [rad/s], [rad/s^2].
    length : float
        Displacement [m].
    """
    step = max(1, len(q) // _MOST)
    motion = list(zip(q[::step], dq[::step], ddq[::step], strict=True))
    nominal = _torques(robot.model, motion)
    total = float(np.sum(nominal**2))
    if total == 0.0:
        return 0.0
    squares = 0.0
    for joint in range(2, robot.model.njoints):
        for axis in np.eye(3):
            model = robot.model.copy()
            shift = pin.SE3(np.eye(3), length * axis)
            model.jointPlacements[joint] = shift * model.jointPlacements[joint]
            squares += float(np.sum((_torques(model, motion) - nominal) ** 2))
    return 100.0 * float(np.sqrt(squares / total))


def geometry_text(result: IdentificationResult) -> str:
    """Return a text on whether the geometry is calibrated, and the possible torque error if not."""
    robot = result.robot
    if is_calibrated(robot):
        return 'The geometry of the URDF is calibrated.'
    samples = result.identification[0].samples
    identified = robot.with_inertial_parameters(result.recommended.estimate.inertial)
    cost = torque_error_per_length(identified, samples.q, samples.dq, samples.ddq)
    return (
        'The geometry of the URDF was not calibrated. An error of 1 mm per axis at each joint '
        f'changes the torque of the links by {cost:.2g} %, of which the identification absorbs a '
        'part. Run the calibrator to measure the geometry.'
    )


def _torques(model: object, motion: list[tuple[Array, Array, Array]]) -> Array:
    data = model.createData()  # type: ignore[attr-defined]
    return np.array([pin.rnea(model, data, *state).copy() for state in motion])
