"""Recorded motions as arrays: from bags, from tables, or from what a program has."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_msgs_py.bags.bag_contents import read_contents
from aerarm_msgs_py.storage.bag_error import BagError as BagError
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.table_file import (
    TABLES,
    TableOptions,
    TableStates,
    read_table,
)

Array = npt.NDArray[np.float64]

Motion = TableStates
"""What was recorded of n joints: names, stamp (M,), position, velocity and effort (M, n)."""

NUMBERED = tuple(f'joint{i}' for i in range(1, 33))
"""What joints without names are called, from base to tool."""


def read_bag(
    path: str | os.PathLike[str],
    topic: str = '/joint_states',
    *,
    rate: float | None = None,
    degrees: bool = False,
    numbered_from: int | None = None,
) -> Motion:
    """Return the joint states of a bag, or of a table, as arrays.

    Parameters
    ----------
    path : path
        rosbag2 directory, .mcap, .db3, .csv or .npz file, or .bag of ROS 1.
    topic : str
        Of the bag's JointStates.
    rate : float, optional
        Of the rows [Hz], for a table without time.
    degrees : bool
        Whether a table's angles are in degrees.
    numbered_from : {0, 1}, optional
        Number of the first joint in a table's columns; recognized from the columns by default.

    Raises
    ------
    BagError, IdentificationError
        If it can't be read; the message says what to check.
    """
    file = Path(path)
    if file.suffix.lower() in TABLES:
        return read_table(file, NUMBERED, TableOptions(rate, degrees, numbered_from))
    name = '/' + topic.lstrip('/')
    states = read_contents(file, name).joint_states[name]
    return Motion(
        tuple(states.names), states.stamp, states.position, states.velocity, states.effort
    )


def from_arrays(
    time: npt.ArrayLike,
    q: npt.ArrayLike,
    tau: npt.ArrayLike,
    dq: npt.ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> Motion:
    """Return arrays or lists as a motion.

    Parameters
    ----------
    time : (M,) array_like
        [s]
    q, tau : (M, n) array_like
        Positions [rad] and torques [Nm].
    dq : (M, n) array_like, optional
        Velocities [rad/s]; positions are differentiated without.
    names : sequence of n str, optional
        Of the joints; joint1, joint2 ... by default.

    Raises
    ------
    IdentificationError
        If a shape is wrong.
    """
    stamp = _numbers('time', time)
    if stamp.ndim != 1:
        raise IdentificationError(f'time has the shape {stamp.shape}: give (M,), one a sample')
    position = _numbers('q', q)
    if position.ndim != 2 or len(position) != len(stamp):
        raise IdentificationError(
            f'q has the shape {position.shape}: give (M, n) with M = {len(stamp)} as time has it'
        )
    joints = NUMBERED[: position.shape[1]] if names is None else tuple(names)
    if len(joints) != position.shape[1]:
        raise IdentificationError(f'{len(joints)} names for {position.shape[1]} joints of q')
    velocity, effort = (_like(position, *given) for given in (('dq', dq), ('tau', tau)))
    return Motion(joints, stamp, position, velocity, effort)


def _like(position: Array, word: str, given: npt.ArrayLike | None) -> Array:
    """Return values (M, n) as positions have them, NaN without any."""
    if given is None:
        return np.full_like(position, np.nan)
    array = _numbers(word, given)
    if array.shape != position.shape:
        raise IdentificationError(
            f'{word} has the shape {array.shape}: give {position.shape} as q has it'
        )
    return array


def _numbers(word: str, values: npt.ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise IdentificationError(f'{word} must be numbers, in rows of equal length') from None
