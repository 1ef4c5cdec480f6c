"""Checks whether the recorded motion matches the options that describe it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.conditioning.periodicity import find_periodic_part
from aerarm_ros.identification.conditioning.uniform_motion import UniformMotion
from aerarm_ros.identification.errors import IdentificationError

FILTERS = ('auto', 'harmonics', 'butterworth')
"""Names of the filters for positions, velocities and accelerations, for the option --filter."""


@dataclass(frozen=True)
class ConditioningOptions:
    """Conditioning settings of the user; None means that the data determine the setting.

    Attributes
    ----------
    fundamental : float or None
        Fundamental frequency f0 of the excitation [Hz].
    harmonics : int or None
        Number of harmonics N of the excitation.
    cutoff : float or None
        Cut-off of the torque's low-pass filter [Hz].
    filter : str
        Filter of the kinematics: 'harmonics' (rectangular windows at the N harmonics of a periodic
        motion, thesis section 3.5), 'butterworth' (zero-phase low-pass) or 'auto'.
    exact_stamps : bool
        Whether all values of a message were measured at its stamp, so that no delay is estimated.
    """

    fundamental: float | None = None
    harmonics: int | None = None
    cutoff: float | None = None
    filter: str = 'auto'
    exact_stamps: bool = False

    def __post_init__(self) -> None:
        """Validate the settings."""
        for name in ('fundamental', 'cutoff'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise IdentificationError(f'{name} = {value} must be a positive frequency [Hz]')
        if self.harmonics is not None and self.harmonics < 1:
            raise IdentificationError(f'harmonics = {self.harmonics} must be at least 1')
        if self.filter not in FILTERS:
            raise IdentificationError(f'filter {self.filter!r}: choose {", ".join(FILTERS)}')


# [s] one period of the excitation in thesis section 3.4; shorter motions cause a warning
_SHORT = 10.0
_TOLERANCE = 0.01  # tolerated relative error of a period
_LARGEST_PART = 0.5  # smallest fraction of a motion's path that must lie in whole periods
_TOO_SHORT = 3.0  # [s] shortest motion that can be identified


def short_motion_warnings(motion: UniformMotion) -> list[str]:
    """Return warnings about recordings with a short motion that is not periodic."""
    duration = motion.count * motion.dt
    if motion.period is not None or duration >= _SHORT:
        return []
    return [
        f'{motion.recording.name} contains only {duration:.1f} s of motion without repetition: '
        f'record at least one whole period of an excitation, {_SHORT:g} s or more (two periods '
        'are '
        'better)'
    ]


def fundamental_warnings(
    motion: UniformMotion, fundamental: float, needed: bool = False
) -> list[str]:
    """Return warnings if a given fundamental frequency differs from the motion's period.

    Parameters
    ----------
    motion : UniformMotion
        Motion whose window was chosen by this fundamental frequency.
    fundamental : float
        Fundamental frequency f0 [Hz].
    needed : bool
        Whether the user requires the filter at the harmonics.

    Raises
    ------
    IdentificationError
        If the frequency is wrong and `needed`, or so high that almost no motion is left.
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
        # Several consecutive periods are periodic as well.
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
    """Return the fraction of the joints' travel that lies in the window used for identification."""
    way = np.abs(np.diff(motion.q, axis=0)).sum(axis=1)
    return float(way[motion.window].sum() / way.sum())


def harmonics_warnings(given: int, found: int, fundamental: float, rate: float) -> list[str]:
    """Return a warning if the motion has more harmonics than the user has stated.

    Parameters
    ----------
    given, found : int
        Number of harmonics given by the user, and found in the spectrum.
    fundamental : float
        Fundamental frequency f0 [Hz].
    rate : float
        Sampling rate [Hz].

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
        f'--harmonics is {given}, but the motion has {found} harmonics, up to '
        f'{found * fundamental:.3g} Hz, and the filter removes harmonics above number {given}: '
        'check '
        'the option, or omit it'
    ]


def aperiodic_warnings(motions: Sequence[UniformMotion], options: ConditioningOptions) -> list[str]:
    """Return warnings about options that need whole periods, if a motion is aperiodic.

    Raises
    ------
    IdentificationError
        If the user requires the filter at the harmonics.
    """
    names = ', '.join(motion.recording.name for motion in motions if motion.period is None)
    if options.filter == 'harmonics':
        reason = f'the motion of {names} does not repeat: record two periods, give --fundamental'
        if options.fundamental is not None:
            reason = (
                f'{names} contains no whole period of --fundamental {options.fundamental:g} Hz: '
                'check that option'
            )
        raise IdentificationError(
            f'--filter harmonics needs whole periods, but {reason}, or choose --filter butterworth'
        )
    if options.harmonics is not None:
        return [
            f'the motion of {names} is not periodic, so --harmonics is ignored: pass --fundamental'
        ]
    return []
