"""Checks of recorded signals: efforts, stamps and units."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.motion.signals import Array

Mask = npt.NDArray[np.bool_]

# An effort spike deviates from the samples before and after it by this multiple of the range of
# the joint's efforts. Dry friction and contacts stay within about one range.
_SPIKE = 3.0
_NEIGHBOURS = 5  # number of samples in a median that up to two consecutive spikes do not change
# largest fraction of samples that are spikes; more frequent deviations belong to the signal
_RARE = 0.01
# A saturated drive reports its largest effort in at least this number of consecutive samples.
_HELD = 10
_HELD_SHARE = 2e-3
# [rad] smallest motion during saturation, because the effort of a resting joint is constant as
# well
_SMALLEST_MOTION = 1e-3


def without_spikes(bag: str, joints: Sequence[str], tau: Array) -> tuple[Array, list[str]]:
    """Return the efforts with spikes replaced by interpolation, and warnings.

    Parameters
    ----------
    bag : str
        Name for warnings.
    tau : (M, n) ndarray
        Efforts [Nm]; not modified.
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
            f'{bag}: {spikes.sum()} spikes in the effort of {joint} are replaced by interpolation'
        )
    return tau, warnings


def saturated_effort(
    bag: str, joints: Sequence[str], q: Array, tau: Array
) -> tuple[Mask | None, list[str]]:
    """Return a mask of samples with the effort at its limit while the joint moves, and warnings.

    Parameters
    ----------
    bag : str
        Name for warnings.
    q, tau : (M, n) ndarray
        Positions [rad] and efforts [Nm].

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
        if share > 0.5:  # an effort with only two values does not mean a saturated drive
            mask[:, index] = False
        elif share > 0.0:
            warnings.append(
                f'{bag}: the effort of {joint} is saturated for {100.0 * share:.2g} % of the '
                'time, and the identifier ignores these samples; record a slower motion'
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
    """Return a mask of samples in long runs at the effort limit, during which the joint moves."""
    held = np.zeros(len(at_limit), dtype=bool)
    if at_limit.sum() < max(_HELD, _HELD_SHARE * len(at_limit)):
        return held
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at_limit.astype(int), [0]))))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        held[first:last] = last - first >= _HELD and np.ptp(q[first:last]) > _SMALLEST_MOTION
    return held


# A middleware may duplicate or swap a message; a higher fraction means a faulty clock.
_TOLERATED_SHARE = 1e-3
# Gaps between messages are interpolated up to this length, because arms move little within it.
_LONGEST_GAP = 0.1  # [s]
# Largest number of consecutive messages that are older than a previous one; more mean that the
# clock was set back.
_LATE_IN_A_ROW = 2
_LONGEST_GAP_PERIODS = 5.0
# Largest typical time between messages. A longer time means that stamps have another unit, for
# example ms.
_LONGEST_STEP = 0.5  # [s]
_OTHER_UNITS = ((5e2, 'milliseconds'), (5e5, 'microseconds'), (np.inf, 'nanoseconds'))

_ADVICE = 'check the clock of the node that stamps the topic, or record again'


def check_stamp_unit(bag: str, stamp: Array) -> None:
    """Raise an error if the intervals of stamps are too long for stamps in seconds.

    Parameters
    ----------
    bag : str
        Name for messages.
    stamp : (M,) ndarray
        Header stamps.

    Raises
    ------
    IdentificationError
        If the intervals are too long; the message names the probable unit.
    """
    steps = np.diff(stamp)
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if step >= _LONGEST_STEP:
        unit = next(name for largest, name in _OTHER_UNITS if step < largest)
        raise IdentificationError(
            f'joint states of {bag} are {step:.3g} s apart, so their stamps look like {unit} '
            'instead of seconds: state the unit in the column name, for example time [ms]'
        )


def usable_messages(
    bag: str, stamp: Array, begin: float | None = None
) -> tuple[npt.NDArray[np.intp], list[str]]:
    """Return the indices of the messages to use, in the order of their stamps, and warnings.

    Duplicates are dropped and messages out of order are sorted, if both are rare.

    Parameters
    ----------
    bag : str
        Name for messages.
    stamp : (M,) ndarray
        Header stamps [s] of the used part.
    begin : float, optional
        First stamp of the whole bag [s], to which times in messages refer; by default the first
        stamp of the part.

    Raises
    ------
    IdentificationError
        If stamps are not finite, repeat, run backwards or jump.
    """
    if not np.isfinite(stamp).all():
        raise IdentificationError(f'stamps of {bag} are not finite: {_ADVICE}')
    if np.ptp(stamp) == 0.0:
        raise IdentificationError(f'all messages of {bag} have the same stamp: {_ADVICE}')
    order = np.argsort(stamp, kind='stable')
    step = np.diff(stamp[order])
    repeated = int(np.sum(step <= 0.0))
    if repeated > _TOLERATED_SHARE * len(stamp):
        first = _when(stamp[order[np.flatnonzero(step <= 0.0)[0]]], stamp, begin)
        raise IdentificationError(
            f'{repeated} of {len(stamp)} stamps of {bag} repeat an earlier stamp, first at '
            f'{first}: {_ADVICE}'
        )
    warnings = _check_order(bag, stamp)
    _check_gaps(bag, stamp[order], step, begin)
    if repeated:
        warnings.append(f'{bag}: {repeated} messages with a repeated stamp are ignored')
    return order[np.concatenate(([True], step > 0.0))], warnings


def _check_order(bag: str, stamp: Array) -> list[str]:
    back = np.flatnonzero(np.diff(stamp) < 0.0)
    if not len(back):
        return []
    farthest = float(-np.diff(stamp)[back].min())
    behind = stamp < np.maximum.accumulate(stamp)
    window = np.ones(_LATE_IN_A_ROW + 1)
    set_back = np.convolve(behind, window).max() > _LATE_IN_A_ROW
    if len(back) > _TOLERATED_SHARE * len(stamp) or farthest > _LONGEST_GAP or set_back:
        raise IdentificationError(
            f'stamps of {bag} jump back {len(back)} times, by up to {farthest:.3f} s, first at '
            f'message {back[0] + 1}: {_ADVICE}'
        )
    return [f'{bag}: {len(back)} messages were out of order and are sorted by their stamps']


def _check_gaps(bag: str, stamp: Array, step: Array, begin: float | None) -> None:
    limit = max(_LONGEST_GAP, _LONGEST_GAP_PERIODS * float(np.median(step)))
    worst = int(np.argmax(step))
    if step[worst] > limit:
        when = _when(float(stamp[worst]), stamp, begin)
        raise IdentificationError(
            f'{bag} has no joint states for {step[worst]:.3f} s at {when}, because the recorder '
            'lost messages or a clock was set: record again'
        )


def _when(instant: float, stamp: Array, begin: float | None) -> str:
    """Return a text with the time of an event in the bag and in the used part of the bag."""
    used = f'{instant - stamp[0]:.2f} s'
    if begin is None or begin == stamp[0]:
        return f'{used} of the bag'
    return f'{instant - begin:.2f} s of the bag ({used} of the used part)'


_LARGEST_TURN = 6.0 * np.pi  # [rad] three turns, more than the range of any arm joint
_AGREES = 0.95  # correlation of measured and differentiated velocities of the same motion
# tolerated ratio of the magnitudes of both velocities, because filters and delays reduce them
_FACTOR = 1.5
# Possible velocity units: name, ratio of velocity to derivative of the positions, and tolerance.
# Revolutions per minute are close to stamps that are ten times too slow.
_VELOCITY_UNITS = (
    ('degrees per second', 180.0 / np.pi, 0.1),
    ('turns per minute', 30.0 / np.pi, 0.02),
)


def check_units(bag: str, joints: Sequence[str], time: Array, q: Array, dq: Array | None) -> None:
    """Raise an error for positions in degrees, or velocities in a wrong unit.

    Parameters
    ----------
    bag : str
        Name for messages.
    time : (M,) ndarray
        Increasing time [s].
    q : (M, n) ndarray
        Positions, expected in [rad].
    dq : (M, n) ndarray or None
        Velocities, expected in [rad/s].

    Raises
    ------
    IdentificationError
        If a unit is wrong; the message names the probable unit.
    """
    ranges = np.ptp(q, axis=0)
    if ranges.max() > _LARGEST_TURN:
        joint, turns = joints[int(np.argmax(ranges))], ranges.max() / (2.0 * np.pi)
        raise IdentificationError(
            f'{joint} moves by {ranges.max():.0f} rad, {turns:.0f} turns, in {bag}, so positions '
            'look like degrees: for a table pass --degrees (degrees= of read_bag, or a column q1 '
            '[deg]), else check the node that publishes the topic'
        )
    ratio = None if dq is None else _speed_ratio(time, q, dq)
    if ratio is None or 1.0 / _FACTOR < ratio < _FACTOR:
        return
    unit = next((u for u, of, near in _VELOCITY_UNITS if abs(ratio / of - 1.0) < near), None)
    if unit is not None:
        cause = f'the velocities look like {unit}, while positions are in rad'
    elif ratio > 1.0:
        cause = f'stamps run {ratio:.3g} times too slow'
    else:
        cause = f'stamps run {1.0 / ratio:.3g} times too fast'
    raise IdentificationError(
        f'{bag}: velocities are {ratio:.3g} times the rate at which positions change, so {cause}; '
        'check the column of the table, or the node that publishes the topic'
    )


_BLOCK = 65536  # samples that are differentiated together, to save memory


def _speed_ratio(time: Array, q: Array, dq: Array) -> float | None:
    """Return the ratio of measured to differentiated velocity; None if the two do not correlate."""
    size, found, along = 0.0, 0.0, 0.0
    for part in np.array_split(np.arange(len(q)), -(-len(q) // _BLOCK)):
        rows = slice(part[0], part[-1] + 1)
        slope = np.gradient(q[rows], time[rows], axis=0)
        size, found = (
            np.hypot(size, np.linalg.norm(slope)),
            np.hypot(found, np.linalg.norm(dq[rows])),
        )
        along += float((slope * dq[rows]).sum())
    if min(size, found) == 0.0:
        return None
    return found / size if along > _AGREES * size * found else None
