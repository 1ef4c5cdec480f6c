"""Whether what the user says of a motion agrees with the motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.conditioning.periodicity import find_periodic_part
from aerarm_ros.identification.conditioning.uniform_motion import UniformMotion
from aerarm_ros.identification.errors import IdentificationError

FILTERS = ('auto', 'harmonics', 'butterworth')
"""Ways to clean the kinematics."""


@dataclass(frozen=True)
class ConditioningOptions:
    """Settings of the user; None is chosen from the data.

    Attributes
    ----------
    fundamental : float or None
        f0 [Hz] of the excitation.
    harmonics : int or None
        N of the excitation.
    cutoff : float or None
        Of the low-pass on torque [Hz].
    filter : str
        How kinematics are cleaned: 'harmonics' (rectangular windows at the N harmonics of a
        periodic motion, thesis section 3.5), 'butterworth' (zero-phase low-pass) or 'auto'.
    exact_stamps : bool
        Whether all of a message is known to be of one instant: no delays are looked for.
    """

    fundamental: float | None = None
    harmonics: int | None = None
    cutoff: float | None = None
    filter: str = 'auto'
    exact_stamps: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ('fundamental', 'cutoff'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise IdentificationError(f'{name} = {value} must be a positive frequency [Hz]')
        if self.harmonics is not None and self.harmonics < 1:
            raise IdentificationError(f'harmonics = {self.harmonics} must be at least 1')
        if self.filter not in FILTERS:
            raise IdentificationError(f'filter {self.filter!r}: choose {", ".join(FILTERS)}')


_SHORT = 10.0  # [s]: one period of the excitation of thesis section 3.4
_TOLERANCE = 0.01  # relative, of a period
_LARGEST_PART = 0.5  # share of a motion's way that its whole periods make up, or they are none
_TOO_SHORT = 3.0  # [s]: nothing is identified from less


def short_motion_warnings(motion: UniformMotion) -> list[str]:
    """Warn of a motion that doesn't repeat itself and is short."""
    duration = motion.count * motion.dt
    if motion.period is not None or duration >= _SHORT:
        return []
    return [
        f'{motion.recording.name} contains only {duration:.1f} s of motion that never repeats: '
        f'record at least one whole period of an excitation, {_SHORT:g} s or more (better two)'
    ]


def fundamental_warnings(
    motion: UniformMotion, fundamental: float, needed: bool = False
) -> list[str]:
    """Compare a given fundamental frequency with the period that the motion shows.

    Parameters
    ----------
    motion : UniformMotion
        Its window has been chosen by this fundamental frequency.
    fundamental : float
        f0 [Hz].
    needed : bool
        Whether the motion is to be filtered at its harmonics, come what may.

    Raises
    ------
    IdentificationError
        If it is wrong, and needed or so high that next to nothing of the motion is left.
    """
    recording = motion.recording
    if motion.period is None:
        return [
            f'{recording.name} contains less than one period of {1.0 / fundamental:.4g} s, so '
            f'--fundamental {fundamental:g} is ignored: check the option, or record whole periods'
        ]
    found = find_periodic_part(recording.time, recording.q)
    if found is None:
        if _share_of_way(motion) >= _LARGEST_PART:
            return []
        shown = f'does not repeat every {1.0 / fundamental:.4g} s'
    else:
        # Several periods, taken together, are periodic as well.
        ratio = 1.0 / (fundamental * found.period)
        if round(ratio) >= 1 and abs(ratio / round(ratio) - 1.0) < _TOLERANCE:
            return []
        shown = f'repeats every {found.period:.4g} s ({found.fundamental:.4g} Hz)'
    text = (
        f'--fundamental is {fundamental:g} Hz, but the motion of {recording.name} {shown}: check '
        'the option, or omit it'
    )
    if needed or motion.count * motion.dt < _TOO_SHORT:
        raise IdentificationError(text)
    return [text]


def _share_of_way(motion: UniformMotion) -> float:
    """Return how much of the way that the joints go lies in the window."""
    way = np.abs(np.diff(motion.q, axis=0)).sum(axis=1)
    return float(way[motion.window].sum() / way.sum())


def harmonics_warnings(given: int, found: int, fundamental: float, rate: float) -> list[str]:
    """Compare a given number of harmonics with the motion's spectrum.

    Parameters
    ----------
    given, found : int
    fundamental : float
        f0 [Hz].
    rate : float
        Of the samples [Hz].

    Raises
    ------
    IdentificationError
        If the harmonics reach beyond the Nyquist frequency.
    """
    if given * fundamental >= 0.5 * rate:
        raise IdentificationError(
            f'harmonic {given} (--harmonics) is at {given * fundamental:.4g} Hz, beyond the '
            f'Nyquist frequency {0.5 * rate:.4g} Hz of the bag: choose fewer harmonics'
        )
    if given >= found:
        return []
    return [
        f'--harmonics is {given}, but the motion has harmonics up to number {found} at '
        f'{found * fundamental:.3g} Hz, whose accelerations are lost: check the option, or omit '
        'it'
    ]


def aperiodic_warnings(motions: Sequence[UniformMotion], options: ConditioningOptions) -> list[str]:
    """Check options for whole periods against motions of which one has none.

    Raises
    ------
    IdentificationError
        If the filter at the harmonics was asked for.
    """
    names = ', '.join(motion.recording.name for motion in motions if motion.period is None)
    if options.filter == 'harmonics' and options.fundamental is not None:
        raise IdentificationError(
            f'--filter harmonics needs whole periods, and {names} contains none of --fundamental '
            f'{options.fundamental:g} Hz: check that option, or choose --filter butterworth'
        )
    if options.filter == 'harmonics':
        raise IdentificationError(
            f'--filter harmonics needs whole periods, and {names} does not repeat: record two '
            'periods, give --fundamental, or choose --filter butterworth'
        )
    if options.harmonics is not None:
        return [f'{names} is not periodic, so --harmonics is ignored: pass --fundamental']
    return []
