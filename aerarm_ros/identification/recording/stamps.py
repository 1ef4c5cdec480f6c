"""Which messages of a bag have stamps that can be trusted."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

# A middleware may deliver a message twice or swap two; more than this is a faulty clock.
_TOLERATED_SHARE = 1e-3
# A gap up to this is bridged by interpolation: arms move little in it.
_LONGEST_GAP = 0.1  # [s]
# Messages in a row behind one that came before: more are a clock set back, not a late message.
_LATE_IN_A_ROW = 2
_LONGEST_GAP_PERIODS = 5.0
# Between two messages, usually: so few would show no motion, so it is another unit. 1 ms are 1.0.
_LONGEST_STEP = 0.5  # [s]
_OTHER_UNITS = ((5e2, 'milliseconds'), (5e5, 'microseconds'), (np.inf, 'nanoseconds'))

_ADVICE = 'check the clock of the node that stamps the topic, or record again'


def check_stamp_unit(bag: str, stamp: Array) -> None:
    """Refuse stamps that are so far apart that they can't be seconds.

    Parameters
    ----------
    bag : str
        Name for messages.
    stamp : (M,) ndarray
        Header stamps.

    Raises
    ------
    IdentificationError
        If they are; what they seem to be is named.
    """
    steps = np.diff(stamp)
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if step >= _LONGEST_STEP:
        unit = next(name for largest, name in _OTHER_UNITS if step < largest)
        raise IdentificationError(
            f'{bag}: joint states are {step:.3g} s apart: stamps are in {unit}, it seems, and must '
            'be in s; the column of a table may state its unit, as time [ms]'
        )


def sound_messages(
    bag: str, stamp: Array, begin: float | None = None
) -> tuple[npt.NDArray[np.intp], list[str]]:
    """Return which messages to use, in the order of their stamps, and warnings.

    A rare message delivered twice or out of order is dropped or put in its place.

    Parameters
    ----------
    bag : str
        Name for messages.
    stamp : (M,) ndarray
        Header stamps [s] of the part that is used.
    begin : float, optional
        First stamp of the whole bag [s], from which messages count; by default that of the part.

    Raises
    ------
    IdentificationError
        If stamps are not finite, repeat, run backwards or jump.
    """
    if not np.isfinite(stamp).all():
        raise IdentificationError(f'{bag}: stamps that are not finite: {_ADVICE}')
    if np.ptp(stamp) == 0.0:
        raise IdentificationError(f'{bag}: every message has the same stamp: {_ADVICE}')
    order = np.argsort(stamp, kind='stable')
    step = np.diff(stamp[order])
    repeated = int(np.sum(step <= 0.0))
    if repeated > _TOLERATED_SHARE * len(stamp):
        first = _when(stamp[order[np.flatnonzero(step <= 0.0)[0]]], stamp, begin)
        raise IdentificationError(
            f'{bag}: {repeated} of {len(stamp)} stamps are repeated, first at {first}: {_ADVICE}'
        )
    warnings = _check_order(bag, stamp)
    _check_gaps(bag, stamp[order], step, begin)
    if repeated:
        warnings.append(f'{bag}: {repeated} messages with a repeated stamp left out')
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
            f'{bag}: stamps jump back {len(back)} times, by up to {farthest:.3f} s, first at '
            f'message {back[0] + 1}: {_ADVICE}'
        )
    return [f'{bag}: {len(back)} messages out of order put in their place']


def _check_gaps(bag: str, stamp: Array, step: Array, begin: float | None) -> None:
    limit = max(_LONGEST_GAP, _LONGEST_GAP_PERIODS * float(np.median(step)))
    worst = int(np.argmax(step))
    if step[worst] > limit:
        when = _when(float(stamp[worst]), stamp, begin)
        raise IdentificationError(
            f'{bag}: no joint states for {step[worst]:.3f} s at {when}: '
            'the recorder lost messages or the clock was set; record again'
        )


def _when(instant: float, stamp: Array, begin: float | None) -> str:
    """Return where in the bag something is, and where in the part of it that is used."""
    used = f'{instant - stamp[0]:.2f} s'
    if begin is None or begin == stamp[0]:
        return f'{used} of the bag'
    return f'{instant - begin:.2f} s of the bag ({used} of the used part)'
