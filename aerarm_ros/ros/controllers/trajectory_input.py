"""JointTrajectory and set point messages for a trajectory follower."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import TrajectoryFollower

# How far from now a trajectory may start [s].
_LATEST, _EARLIEST = 1.0, 60.0


def follow_trajectory(follower: TrajectoryFollower, message: TrajectoryMessage, now: float) -> None:
    """Execute a trajectory from its stamp on, from `now` [s] if that is zero.

    A trajectory without points stops the arm. Raises RejectedInputError.
    """
    if not message.points:
        follower.stop(now, 'stopped: empty trajectory')
        return
    trajectory, start = read_trajectory(follower.limits, message, now)
    follower.follow(trajectory, now, start)


def read_trajectory(
    limits: JointLimits, message: TrajectoryMessage, now: float
) -> tuple[JointTrajectory, float | None]:
    """Return a message's trajectory, and when it starts [s], None for now.

    Raises RejectedInputError.
    """
    points = message.points
    trajectory = JointTrajectory(
        limits,
        list(message.joint_names),
        [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points],
        [list(p.positions) for p in points],
        [list(p.velocities) for p in points],
        [list(p.accelerations) for p in points],
    )
    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    if stamp and not -_LATEST <= stamp - now <= _EARLIEST:
        raise RejectedInputError(
            f'trajectory: it is stamped {stamp - now:+.1f} s from now (allowed: {-_LATEST:+g} to '
            f'{_EARLIEST:+g}): use a zero stamp for now, and check the clocks'
        )
    return trajectory, stamp or None


def go_to_set_point(follower: TrajectoryFollower, message: JointState, now: float) -> None:
    """Go to the positions of a set point. Raises RejectedInputError."""
    limits: JointLimits = follower.limits
    order = limits.order(list(message.name))
    if len(message.position) != limits.n:
        raise RejectedInputError(f'set point: it needs {limits.n} positions')
    q = np.array(message.position)[order]
    if not np.all(np.isfinite(q)):
        raise RejectedInputError('set point: positions must be finite numbers')
    follower.go_to(q, now)
