"""What a user may say about a motion and how to filter it."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError

FILTERS = ('auto', 'harmonics', 'butterworth')
"""Ways to clean the kinematics."""


@dataclass(frozen=True)
class ConditioningOptions:
    """What the user may fix; None is found from the data.

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
