"""Tolerances that come with a goal, in place of a follower's own."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.references.follower_tolerances import FollowerTolerances

# What control_msgs writes: the follower's own, and none at all.
_DEFAULT, _NONE = 0.0, -1.0


def resolve_tolerances(
    own: FollowerTolerances,
    names: Sequence[str],
    path: Iterable[tuple[str, float]] = (),
    goal: Iterable[tuple[str, float]] = (),
    goal_time: float = _DEFAULT,
) -> FollowerTolerances:
    """Return the tolerances of one goal, as joint_trajectory_controller reads them.

    Zero is the follower's own value, -1 none at all.

    Parameters
    ----------
    own
        Of the follower.
    names
        The arm's n joints.
    path, goal
        Joints and their tolerances [rad], those that differ.
    goal_time
        [s]

    Raises
    ------
    RejectedInputError
        If a joint isn't the arm's, or a value is neither positive nor 0 nor -1.
    """
    time = _resolve('goal_time_tolerance', own.goal_time, goal_time)
    return replace(
        own,
        path=_resolve_each('path_tolerance', own.path, names, path),
        goal=_resolve_each('goal_tolerance', own.goal, names, goal),
        goal_time=time,
    )


def _resolve_each(
    what: str,
    own: npt.NDArray[np.float64],
    names: Sequence[str],
    given: Iterable[tuple[str, float]],
) -> npt.NDArray[np.float64]:
    resolved = own.copy()
    for name, value in given:
        if name not in names:
            raise RejectedInputError(f'{what}: the arm has no joint {name!r}')
        joint = list(names).index(name)
        resolved[joint] = _resolve(f'{what} of {name}', own[joint], value)
    return resolved


def _resolve(what: str, own: float, value: float) -> float:
    if value == _DEFAULT:
        return own
    if value == _NONE:
        return np.inf
    if not 0.0 < value < np.inf:
        raise RejectedInputError(
            f'{what} = {value:g}: give a positive number, 0 for the default or -1 for none'
        )
    return value
