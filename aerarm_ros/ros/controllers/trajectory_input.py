"""JointTrajectory and set point messages for a trajectory follower."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import TrajectoryFollower

# How far from now a trajectory may start [s].
_LATEST, _EARLIEST = 1.0, 60.0


def follow_trajectory(
    follower: TrajectoryFollower, message: TrajectoryMessage, now: float, partial: bool = False
) -> None:
    """Execute a trajectory from its stamp on, from `now` [s] if that is zero.

    A trajectory without points stops the arm. Raises RejectedInputError.

    Parameters
    ----------
    follower, message, now
        What moves, along what, from when on.
    partial
        Whether the message may name some of the joints; the others stay where their reference is.
    """
    if not message.points:
        follower.stop(now, 'stopped: empty trajectory')
        return
    staying = follower.reference.q if partial else None
    trajectory, start = read_trajectory(follower.limits, message, now, staying)
    follower.follow(trajectory, now, start)


def read_trajectory(
    limits: JointLimits,
    message: TrajectoryMessage,
    now: float,
    staying: npt.NDArray[np.float64] | None = None,
) -> tuple[JointTrajectory, float | None]:
    """Return a message's trajectory, and when it starts [s], None for now.

    Parameters
    ----------
    limits, message, now
        Of the arm, what was sent, and when it was read [s].
    staying
        Where joints stay (n,) [rad] that the message does not name, as
        joint_trajectory_controller holds them with `allow_partial_joints_goal`. Without it the
        message has to name all of them.

    Raises
    ------
    RejectedInputError
        If it isn't a trajectory of this arm, or is stamped in the past.
    """
    points, names = message.points, list(message.joint_names)
    others = [] if staying is None else _unnamed(limits, message)
    held = [] if staying is None else staying[others].tolist()
    zero = [0.0] * len(others)
    trajectory = JointTrajectory(
        limits,
        names + [limits.names[joint] for joint in others],
        [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points],
        [_filled(p.positions, held) for p in points],
        [_filled(p.velocities, zero) for p in points],
        [_filled(p.accelerations, zero) for p in points],
    )
    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    if stamp and not -_LATEST <= stamp - now <= _EARLIEST:
        raise RejectedInputError(
            f'trajectory: it is stamped {stamp - now:+.1f} s from now (allowed: {-_LATEST:+g} to '
            f'{_EARLIEST:+g}): use a zero stamp for now, and check the clocks'
        )
    return trajectory, stamp or None


def _unnamed(limits: JointLimits, message: TrajectoryMessage) -> list[int]:
    """Return the joints that a message leaves out; RejectedInputError if it fits no joints."""
    names = list(message.joint_names)
    if not names or len(set(names)) < len(names) or not set(names) <= set(limits.names):
        raise RejectedInputError(
            f'joint names {names} are not those of the arm: give some of {list(limits.names)}, '
            'each once'
        )
    for what in ('positions', 'velocities', 'accelerations'):
        counts = [len(getattr(point, what)) for point in message.points]
        for index, count in enumerate(counts):
            if any(counts) and count != len(names):
                raise RejectedInputError(
                    f'trajectory: point {index} has {count} {what}, but {len(names)} joints are '
                    'named: give one for each, at every point or at none'
                )
    return [joint for joint, name in enumerate(limits.names) if name not in names]


def _filled(given: Sequence[float], others: Sequence[float]) -> list[float]:
    return [*given, *others] if len(given) else []


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
