"""Periodic, band-limited joint trajectories, thesis section 3.4."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Finite Fourier series of each joint, thesis (3.16).

    q_i(t) = q0_i + sum_k alpha_ik sin(k w0 t) + beta_ik cos(k w0 t), with w0 = 2 pi f0.

    Velocity and acceleration are its true derivatives; (3.17) as printed has sine and cosine
    swapped.

    Parameters
    ----------
    f0 : fundamental frequency [Hz].
    q0 : (n,) centre of the motion [rad].
    alpha, beta : (n, N) sine and cosine coefficients of the N harmonics [rad].

    Raises
    ------
    ExcitationError
        If shapes disagree, a value is not finite, or f0 is not positive.
    """

    f0: float
    q0: FloatArray
    alpha: FloatArray
    beta: FloatArray

    def __post_init__(self) -> None:
        for field in ('q0', 'alpha', 'beta'):
            # A private read-only copy: whoever drew the coefficients may reuse the arrays.
            values = np.array(getattr(self, field), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field, values)
        if not (np.isfinite(self.f0) and self.f0 > 0.0):
            raise ExcitationError(f'fundamental frequency must be positive, got {self.f0} Hz')
        if self.q0.ndim != 1 or self.alpha.ndim != 2 or self.alpha.shape[0] != self.q0.size:
            raise ExcitationError(
                f'Fourier coefficients must be (joints, harmonics) for {self.q0.size} joints, '
                f'got alpha {self.alpha.shape}'
            )
        if self.alpha.shape != self.beta.shape or self.harmonics == 0:
            raise ExcitationError(
                'sine and cosine coefficients must have one shape with at least one harmonic, '
                f'got alpha {self.alpha.shape} and beta {self.beta.shape}'
            )
        if not all(np.isfinite(v).all() for v in (self.q0, self.alpha, self.beta)):
            raise ExcitationError('Fourier coefficients must be finite numbers')

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q0.size)

    @property
    def harmonics(self) -> int:
        """Number of harmonics N."""
        return int(self.alpha.shape[1])

    @property
    def period(self) -> float:
        """Period 1 / f0 [s]."""
        return 1.0 / self.f0

    @property
    def highest_frequency(self) -> float:
        """Frequency of the highest harmonic N f0 [Hz]."""
        return self.harmonics * self.f0

    @cached_property
    def angular_frequencies(self) -> FloatArray:
        """Angular frequencies k w0 of the harmonics [rad/s], (N,)."""
        return 2.0 * np.pi * self.f0 * np.arange(1.0, self.harmonics + 1.0)

    @cached_property
    def _coefficients(self) -> FloatArray:
        """Weights (2N, 3n) of all sines and cosines in position, velocity and acceleration."""
        w = self.angular_frequencies[:, np.newaxis]
        alpha, beta = self.alpha.T, self.beta.T
        of_sine = [alpha, -w * beta, -(w**2) * alpha]
        of_cosine = [beta, w * alpha, -(w**2) * beta]
        return np.block([of_sine, of_cosine])

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return position, velocity and acceleration at `time` [s], scalar or (M,)."""
        angle = np.multiply.outer(time, self.angular_frequencies)
        basis = np.concatenate([np.sin(angle), np.cos(angle)], axis=-1)
        terms = basis @ self._coefficients
        n = self.n
        return JointReference(self.q0 + terms[..., :n], terms[..., n : 2 * n], terms[..., 2 * n :])
