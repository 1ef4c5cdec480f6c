"""Recorded efforts that do not tell a joint's torque: spikes and saturation."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# A spike leaves its neighbours by this many times the range of all of the joint's efforts, and
# comes back: dry friction or a contact stay within about one range.
_SPIKE = 3.0
_NEIGHBOURS = 5  # samples whose median a spike does not move, two in a row neither
_RARE = 0.01  # share of the samples: what is more frequent is no spike but the signal
# A drive at its limit reports the same number, the largest, this often and in a row.
_HELD = 10
_HELD_SHARE = 2e-3
_SMALLEST_MOTION = 1e-3  # [rad]: an effort that rests with its joint is not saturated


def without_spikes(bag: str, joints: Sequence[str], tau: Array) -> tuple[Array, list[str]]:
    """Return the efforts with spikes replaced by the line between their neighbours, and warnings.

    Parameters
    ----------
    bag : str
        Name for warnings.
    joints : sequence of n str
    tau : (M, n) ndarray
        [Nm]; not changed.
    """
    warnings = []
    for index, joint in enumerate(joints):
        spikes = _spikes(tau[:, index])
        if not spikes.any():
            continue
        rows = np.arange(len(tau))
        tau = tau.copy()
        tau[spikes, index] = np.interp(rows[spikes], rows[~spikes], tau[~spikes, index])
        warnings.append(
            f'{bag}: {spikes.sum()} spikes in the effort of {joint} bridged by their neighbours'
        )
    return tau, warnings


def saturated_effort(
    bag: str, joints: Sequence[str], q: Array, tau: Array
) -> tuple[Mask | None, list[str]]:
    """Return where efforts stay at their limit while the joint moves, and warnings.

    Parameters
    ----------
    bag : str
        Name for warnings.
    joints : sequence of n str
    q, tau : (M, n) ndarray
        [rad], [Nm]

    Returns
    -------
    (M, n) ndarray of bool or None
        None if no effort is saturated.
    list of str
    """
    mask, warnings = np.zeros(tau.shape, dtype=bool), []
    for index, joint in enumerate(joints):
        column = tau[:, index]
        for limit in (column.min(), column.max()):
            mask[:, index] |= _held(column == limit, q[:, index])
        share = float(mask[:, index].mean())
        if share > 0.5:  # a torque of two values only is odd, but no drive at its limit
            mask[:, index] = False
        elif share > 0.0:
            warnings.append(
                f'{bag}: effort of {joint} is saturated for {100.0 * share:.2g} % of the time: '
                'left out; record a slower motion'
            )
    return (mask if mask.any() else None), warnings


def _spikes(column: Array) -> Mask:
    low, high = np.percentile(column, [1.0, 99.0])
    least = _SPIKE * (high - low)
    none = np.zeros(len(column), dtype=bool)
    if least == 0.0 or not (np.abs(np.diff(column)) > least).any():
        return none
    padded = np.pad(column, _NEIGHBOURS // 2, mode='edge')
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, _NEIGHBOURS), axis=1)
    spikes = np.abs(column - around) > least
    return np.asarray(spikes) if spikes.mean() <= _RARE else none


def _held(at_limit: Mask, q: Array) -> Mask:
    """Return the long runs at the limit in which the joint moves."""
    held = np.zeros(len(at_limit), dtype=bool)
    if at_limit.sum() < max(_HELD, _HELD_SHARE * len(at_limit)):
        return held
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at_limit.astype(int), [0]))))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        held[first:last] = last - first >= _HELD and np.ptp(q[first:last]) > _SMALLEST_MOTION
    return held
