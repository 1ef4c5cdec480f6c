"""Joint states of a Fourier trajectory as linear functions of its coefficients."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


class StateBasis:
    """Sampled states of one period, then of run-in and run-out, from a coefficient matrix.

    The coefficient matrix X (1 + 2N, n) holds a column a joint: bias, sine and cosine
    coefficients. Position, velocity and acceleration are linear in it, so their bases are the
    states of trajectories with a single coefficient of one.

    Parameters
    ----------
    fundamental : f0 [Hz].
    harmonics : N.
    n : number of joints.
    ramp_time : run-in and run-out [s].
    samples_per_oscillation : samples in one period of the highest harmonic.
    """

    def __init__(
        self,
        fundamental: float,
        harmonics: int,
        n: int,
        ramp_time: float,
        samples_per_oscillation: int = 40,
    ) -> None:
        self.fundamental = fundamental
        self.harmonics = harmonics
        self.n = n
        rows = 1 + 2 * harmonics
        identity = np.eye(rows)
        sine, cosine = slice(1, 1 + harmonics), slice(1 + harmonics, rows)
        unit = FourierTrajectory(fundamental, identity[0], identity[:, sine], identity[:, cosine])
        played = RampedExcitation(unit, 1, ramp_time)
        step = 1.0 / (fundamental * harmonics * samples_per_oscillation)
        self.period_samples = harmonics * samples_per_oscillation
        """How many samples belong to the period; those of the ramps follow."""
        ramp = np.linspace(0.0, ramp_time, max(int(ramp_time / step), 2))
        self.times: FloatArray = np.concatenate(
            [
                ramp_time + step * np.arange(self.period_samples),
                ramp[:-1],
                played.duration - ramp[::-1][1:],
            ]
        )
        self._basis = played.evaluate(self.times)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (1 + 2N, n) of the coefficient matrix."""
        return 1 + 2 * self.harmonics, self.n

    def coefficients(self, trajectory: FourierTrajectory) -> FloatArray:
        """Return the coefficient matrix of a trajectory [rad]."""
        return np.vstack([trajectory.q0, trajectory.alpha.T, trajectory.beta.T])

    def trajectory(self, coefficients: FloatArray) -> FourierTrajectory:
        """Return the trajectory of a coefficient matrix [rad]."""
        sine, cosine = np.split(coefficients[1:], 2)
        return FourierTrajectory(self.fundamental, coefficients[0], sine.T, cosine.T)

    def states(self, coefficients: FloatArray) -> JointReference:
        """Return the (M, n) states of a coefficient matrix."""
        return JointReference(*(basis @ coefficients for basis in self._basis))

    def pull_back(self, *gradients: FloatArray) -> FloatArray:
        """Return the gradient by the coefficients of a function of the states.

        Parameters
        ----------
        gradients : (M, n) derivatives by position, velocity and acceleration; trailing ones may
            be left out.
        """
        parts = [
            basis[: len(gradient)].T @ gradient
            for basis, gradient in zip(self._basis, gradients, strict=False)
        ]
        return np.asarray(sum(parts))
