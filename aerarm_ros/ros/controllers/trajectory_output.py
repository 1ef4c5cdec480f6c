"""Conversion of a motion to a JointTrajectory message."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_ros.motion.signals import JointMotion

POINT_PERIOD = 0.02
"""[s] between two points, short enough for interpolation by quintics."""

_SECOND = 1_000_000_000


def trajectory_message(
    motion: JointMotion, names: Sequence[str], start_ns: int = 0
) -> JointTrajectory:
    """Return points of a motion with velocity and acceleration as a message.

    Parameters
    ----------
    motion
        Motion of n joints.
    names
        Names of the joints.
    start_ns
        Start in the time of the states [ns]; 0 to start at once.
    """
    times = np.append(np.arange(0.0, motion.duration - 1e-6, POINT_PERIOD), motion.duration)
    q, dq, ddq = motion.evaluate(times)
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = Time(**_split(start_ns))
    message.points = [
        JointTrajectoryPoint(
            positions=q[k].tolist(),
            velocities=dq[k].tolist(),
            accelerations=ddq[k].tolist(),
            time_from_start=Duration(**_split(round(when * _SECOND))),
        )
        for k, when in enumerate(times)
    ]
    return message


def _split(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, _SECOND)
    return {'sec': seconds, 'nanosec': rest}
