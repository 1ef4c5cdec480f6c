"""Whether positions, velocities and stamps of a recording are in the units that they should be."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

_LARGEST_TURN = 6.0 * np.pi  # [rad] of a joint from end to end: three turns, more than arms have
_AGREES = 0.95  # correlation of measured and differentiated velocities that are the same motion
_FACTOR = 1.5  # by which they may differ in size: filters and delays make less of them
# What velocities may be: name, how many times the rate of the positions, and how nearly. Turns per
# minute are not far from stamps ten times too slow.
_VELOCITY_UNITS = (
    ('degrees per second', 180.0 / np.pi, 0.1),
    ('turns per minute', 30.0 / np.pi, 0.02),
)


def check_units(bag: str, joints: Sequence[str], time: Array, q: Array, dq: Array | None) -> None:
    """Refuse positions in degrees, and velocities that are not the rate of the positions.

    Parameters
    ----------
    bag : str
        Name for messages.
    joints : sequence of n str
    time : (M,) ndarray
        [s], increasing.
    q : (M, n) ndarray
        [rad] if all is well.
    dq : (M, n) ndarray or None
        [rad/s] if all is well.

    Raises
    ------
    IdentificationError
        If they are not; what they seem to be is named.
    """
    ranges = np.ptp(q, axis=0)
    if ranges.max() > _LARGEST_TURN:
        joint, turns = joints[int(np.argmax(ranges))], ranges.max() / (2.0 * np.pi)
        raise IdentificationError(
            f'{bag}: {joint} moves by {ranges.max():.0f} rad, {turns:.0f} turns: '
            'positions are in degrees, it seems, not in rad; say so of a table (--degrees, '
            'degrees= of read_bag, or a column q1 [deg]), else check the node that publishes the '
            'topic'
        )
    ratio = None if dq is None else _speed_ratio(time, q, dq)
    if ratio is None or 1.0 / _FACTOR < ratio < _FACTOR:
        return
    text = f'{bag}: velocities are {ratio:.3g} times the rate at which positions change'
    unit = next((u for u, of, near in _VELOCITY_UNITS if abs(ratio / of - 1.0) < near), None)
    if unit is not None:
        text += f': they are in {unit}, it seems, and positions in rad'
    elif ratio > 1.0:
        text += f': stamps run {ratio:.3g} times too slow, it seems'
    else:
        text += f': stamps run {1.0 / ratio:.3g} times too fast, it seems'
    raise IdentificationError(
        f'{text}; check the column of the table, or the node that publishes the topic'
    )


def _speed_ratio(time: Array, q: Array, dq: Array) -> float | None:
    """Return measured over differentiated velocities; None where they aren't the same motion."""
    slope = np.gradient(q, time, axis=0)
    size, found = float(np.linalg.norm(slope)), float(np.linalg.norm(dq))
    if min(size, found) == 0.0:
        return None
    along = float((slope * dq).sum())
    return found / size if along > _AGREES * size * found else None
