"""How positions, velocities and accelerations are cleaned, thesis section 3.5."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.spectral_filter import (
    SETTLING_PERIODS,
    SpectralFilter,
    harmonic_gain,
    low_pass_gain,
)
from aerarm_ros.identification.conditioning.uniform_motion import UniformMotion

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class KinematicsFilter:
    """A choice of filter and of the source of velocity and acceleration.

    Attributes
    ----------
    cutoff : float
        Of the zero-phase low-pass [Hz].
    harmonics : int or None
        Pass constant and this many harmonics of whole periods only (rectangular windows in
        the frequency domain); None for the low-pass.
    from_position : bool
        Differentiate positions (once, twice) rather than measured velocities.
    in_time : bool
        Whether what measured velocities are late has been taken off.
    """

    cutoff: float
    harmonics: int | None = None
    from_position: bool = False
    in_time: bool = False

    @property
    def label(self) -> str:
        """Short text for reports."""
        if self.harmonics is None:
            return f'zero-phase Butterworth at {self.cutoff:.3g} Hz, {self.source}'
        return f'rectangular windows at {self.harmonics} harmonics, {self.source}'

    @property
    def source(self) -> str:
        """Where velocities come from, in words."""
        if self.from_position:
            return 'differentiated positions'
        return 'measured velocities' + (', their lag taken off' if self.in_time else '')

    def apply(self, motion: UniformMotion) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq of the motion's window.

        Parameters
        ----------
        motion : UniformMotion
            Its window must consist of whole periods if `harmonics` is given.

        Returns
        -------
        three (M, n) ndarrays
            [rad], [rad/s], [rad/s^2] at the full rate; acceleration is the derivative of
            the filtered velocity, section 3.5.1.
        """
        if self.harmonics is not None and motion.period is not None:
            fundamental = 1.0 / (motion.period * motion.dt)
            gain = harmonic_gain(fundamental, self.harmonics)
            smooth = SpectralFilter(motion.count, motion.dt, gain)
            part, inside = motion.window, slice(None)
        else:
            # The whole recording is filtered so that the window's ends have a real past.
            gain = low_pass_gain(self.cutoff)
            settling = SETTLING_PERIODS / self.cutoff
            smooth = SpectralFilter(len(motion.time), motion.dt, gain, settling=settling)
            part, inside = slice(None), motion.window
        q = motion.q[part]
        if self.from_position or motion.dq is None:
            parts = smooth(q), smooth(q, derivative=1), smooth(q, derivative=2)
        else:
            dq = motion.dq[part]
            parts = smooth(q), smooth(dq), smooth(dq, derivative=1)
        return parts[0][inside], parts[1][inside], parts[2][inside]
