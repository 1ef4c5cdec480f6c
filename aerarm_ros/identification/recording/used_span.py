"""Which part of a bag shows the arm following commands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RUNNING = 'running'
"""Mode in which the bridge follows commands."""

_SMALLEST_MOTION = 1e-3  # [rad], as far as a joint that rests may stray
_MARGIN = 0.5  # [s] kept at both ends of a motion, as the filters' past
_LONGEST_PAUSE = 0.5  # [s] between two commands of one motion
_LOOKS = 1000  # positions that measure a motion: with every one, noise would add up


@dataclass(frozen=True)
class UsedSpan:
    """The part of a bag that is used.

    Attributes
    ----------
    first, last : float
        Its ends [s], since the bag's first state.
    whole : float
        Duration of the bag [s].
    reason : str
        What it was chosen by.
    """

    first: float
    last: float
    whole: float
    reason: str

    @property
    def text(self) -> str:
        """Short text for reports."""
        return f'{self.first:.1f} .. {self.last:.1f} s of {self.whole:.1f} s ({self.reason})'


def running_span(
    time: Array, q: Array, modes: Sequence[tuple[float, str]]
) -> tuple[slice, str] | None:
    """Return the rows in which an arm follows commands, by the modes its bridge announced.

    Idle, aligning, ready and damping arms rest, are moved by the boards, or sink: none of
    that is the motion that was commanded.

    Parameters
    ----------
    time : (M,) ndarray
        Reception of the joint states [s].
    q : (M, n) ndarray
        [rad]
    modes : sequence of (time, mode)
        Reception [s], in order, and mode.

    Returns
    -------
    slice and reason, or None if no mode is known or the arm never ran. Of several runs the
    one with most motion.
    """
    runs = []
    for index, (begin, mode) in enumerate(modes):
        if mode != RUNNING:
            continue
        # The first mode is the one that was in force when recording began.
        first = 0 if index == 0 else int(np.searchsorted(time, begin))
        end = modes[index + 1][0] if index + 1 < len(modes) else np.inf
        last = int(np.searchsorted(time, end))
        if last - first > 1:
            runs.append(slice(first, last))
    return _liveliest(q, runs, f'arm_mode {RUNNING}')


def commanded_span(stamp: Array, q: Array, commands: Array) -> tuple[slice, str] | None:
    """Return the rows while commands came.

    Parameters
    ----------
    stamp : (M,) ndarray
        Of the joint states [s].
    q : (M, n) ndarray
        [rad]
    commands : (K,) ndarray
        Stamps of the commands [s].
    """
    commands = np.sort(commands[np.isfinite(commands)])
    if len(commands) < 2:
        return None
    steps = np.diff(commands)
    pauses = np.flatnonzero(steps > max(_LONGEST_PAUSE, 5.0 * float(np.median(steps))))
    begins = commands[np.concatenate(([0], pauses + 1))]
    ends = commands[np.concatenate((pauses, [len(commands) - 1]))]
    runs = []
    for begin, end in zip(begins, ends, strict=True):
        inside = np.flatnonzero((stamp >= begin) & (stamp <= end))
        if len(inside) > 1:
            runs.append(slice(int(inside[0]), int(inside[-1]) + 1))
    return _liveliest(q, runs, 'joint_command')


def moving_span(time: Array, q: Array) -> tuple[slice, str]:
    """Return the rows from first to last motion, with a short rest before and after."""
    time = np.maximum.accumulate(time)  # what runs backwards is judged by others
    ends = [end for column in q.T if (end := _ends_of_motion(column)) is not None]
    if not ends:
        return slice(0, len(q)), 'whole bag'
    left, arrived = min(first for first, _ in ends), max(last for _, last in ends)
    first = int(np.searchsorted(time, time[left] - _MARGIN))
    last = int(np.searchsorted(time, time[arrived] + _MARGIN, side='right'))
    whole = first == 0 and last >= len(q)
    return slice(first, last), 'whole bag' if whole else 'motion'


def _ends_of_motion(q: Array) -> tuple[int, int] | None:
    """Return when a joint has left its first position and not yet reached its last one."""
    finite = np.isfinite(q)
    if not finite.any():
        return None
    first, last = q[np.argmax(finite)], q[len(q) - 1 - np.argmax(finite[::-1])]
    away = finite & (np.abs(q - first) > _SMALLEST_MOTION)
    to_go = finite & (np.abs(q - last) > _SMALLEST_MOTION)
    if not (away.any() and to_go.any()):
        return None
    return int(np.argmax(away)), len(q) - 1 - int(np.argmax(to_go[::-1]))


def _liveliest(q: Array, runs: Sequence[slice], reason: str) -> tuple[slice, str] | None:
    """Return the run that moves farthest; None if none moves."""
    travel = [_travel(q[run]) for run in runs]
    if not travel or max(travel) < _SMALLEST_MOTION:
        return None
    others = f', the liveliest of {len(runs)}' if len(runs) > 1 else ''
    return runs[int(np.argmax(travel))], reason + others


def _travel(q: Array) -> float:
    thinned = q[:: max(1, len(q) // _LOOKS)]
    return float(np.nansum(np.abs(np.diff(thinned, axis=0))))
