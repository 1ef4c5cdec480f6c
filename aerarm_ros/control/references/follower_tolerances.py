"""What a trajectory follower tolerates."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import non_negative, positive

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FollowerTolerances:
    """Tolerances of n joints, and times.

    Attributes
    ----------
    start : (n,) ndarray
        Distance [rad] of a trajectory's first point from the present reference.
    path : (n,) ndarray
        Error [rad] under way beyond which the motion is aborted; positive, infinite for no check.
    goal : (n,) ndarray
        Error [rad] at which the goal counts as reached; positive, infinite for no check.
    goal_time : float
        Time [s] after the end to reach the goal.
    stream_timeout : float
        Silence [s] after which a streamed reference brakes.
    """

    start: Array
    path: Array
    goal: Array
    goal_time: float
    stream_timeout: float

    @classmethod
    def uniform(
        cls,
        n: int,
        start: float = 0.1,
        path: float = 0.3,
        goal: float = 0.01,
        goal_time: float = 1.0,
        stream_timeout: float = 0.1,
    ) -> 'FollowerTolerances':
        """Return the same tolerances for each of n joints.

        Raises
        ------
        ValueError
            If a value isn't positive.
        """
        return cls(
            start=non_negative('start', start, n),
            path=np.full(n, _limit('path', path)),
            goal=np.full(n, _limit('goal', goal)),
            goal_time=_limit('goal_time', goal_time),
            stream_timeout=positive('stream_timeout', stream_timeout),
        )


def _limit(name: str, value: float) -> float:
    return value if value == np.inf else positive(name, value)
