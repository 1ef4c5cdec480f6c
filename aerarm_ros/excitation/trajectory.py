"""Excitation trajectories: Fourier series of thesis (3.16), strokes, transfers and sequences."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.motion.polynomial_path import PEAK_SLOPE, PolynomialPath, smooth_step
from aerarm_ros.motion.signals import Array, JointMotion, JointReference


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Finite Fourier series of each joint, thesis (3.16).

    q_i(t) = q0_i + sum_k alpha_ik sin(k w0 t) + beta_ik cos(k w0 t), with w0 = 2 pi f0.

    Velocity and acceleration are the exact derivatives; (3.17) as printed has sine and cosine
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
    q0: Array
    alpha: Array
    beta: Array

    def __post_init__(self) -> None:
        for field in ('q0', 'alpha', 'beta'):
            # The trajectory keeps read-only copies, because the caller may reuse the arrays.
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
                'sine and cosine coefficients must have the same shape with at least one '
                f'harmonic, got alpha {self.alpha.shape} and beta {self.beta.shape}'
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
        """Frequency N f0 of the highest harmonic [Hz]."""
        return self.harmonics * self.f0

    def slowed(self, factor: float) -> 'FourierTrajectory':
        """Return the same shape with a period that is `factor` times as long."""
        return FourierTrajectory(self.f0 / factor, self.q0, self.alpha, self.beta)

    @cached_property
    def angular_frequencies(self) -> Array:
        """Angular frequencies k w0 of the harmonics [rad/s], (N,)."""
        return 2.0 * np.pi * self.f0 * np.arange(1.0, self.harmonics + 1.0)

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients (2N, 3n) of all sines and cosines in position, velocity and acceleration."""
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


def transfer(start: ArrayLike, end: ArrayLike, duration: float) -> PolynomialPath:
    """Return the quintic from rest at `start` (n,) [rad] to rest at `end` (n,) [rad].

    Raises
    ------
    ExcitationError
        If the duration [s] is not positive or a posture is not finite.
    """
    if not (np.isfinite(duration) and duration > 0.0):
        raise ExcitationError(f'duration of a transfer must be positive, got {duration} s')
    ends = np.array([start, end], dtype=float)
    if not np.isfinite(ends).all():
        raise ExcitationError('the postures of a transfer must be finite numbers')
    return PolynomialPath.rest_to_rest(ends[0], ends[1], duration)


def standstill(position: ArrayLike) -> PolynomialPath:
    """Return a motion of one control cycle at rest at `position` (n,) [rad]."""
    return transfer(position, position, 1e-3)


@dataclass(frozen=True)
class Stage:
    """Part of a motion sequence, with a name."""

    name: str
    motion: JointMotion


class MotionSequence:
    """Motion that consists of consecutive stages.

    Parameters
    ----------
    stages : at least one; each must start at the end of the previous stage, within 1e-9 in position
        [rad], velocity [rad/s] and acceleration [rad/s^2].

    Raises
    ------
    ExcitationError
        If there is no stage, or consecutive stages do not join.
    """

    _JOIN_TOLERANCE = 1e-9

    def __init__(self, stages: Sequence[Stage]) -> None:
        if not stages:
            raise ExcitationError('a motion needs at least one stage')
        for before, after in zip(stages, stages[1:], strict=False):
            self._require_joined(before, after)
        self.stages = tuple(stages)
        durations = [stage.motion.duration for stage in stages]
        self.boundaries: Array = np.concatenate([[0.0], np.cumsum(durations)])
        self._starts: list[float] = self.boundaries[:-1].tolist()

    @classmethod
    def _require_joined(cls, before: Stage, after: Stage) -> None:
        end = before.motion.evaluate(before.motion.duration)
        start = after.motion.evaluate(0.0)
        gap = max(np.abs(e - s).max() for e, s in zip(end, start, strict=True))
        if gap > cls._JOIN_TOLERANCE:
            raise ExcitationError(
                f'stage {after.name} does not start where {before.name} ends (gap {gap:.3g})'
            )

    @property
    def duration(self) -> float:
        """Total duration of all stages [s]."""
        return float(self.boundaries[-1])

    def stage_at(self, time: float) -> Stage:
        """Return the active stage at `time` [s]."""
        return self.stages[self._index(time)]

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,); constant outside the duration."""
        if np.ndim(time) == 0:
            return self._evaluate_one(float(time))  # type: ignore[arg-type]
        time = np.asarray(time, dtype=float)
        index = np.clip(
            np.searchsorted(self.boundaries, time, side='right') - 1, 0, len(self.stages) - 1
        )
        parts = [
            stage.motion.evaluate(time[index == i] - self.boundaries[i])
            for i, stage in enumerate(self.stages)
        ]
        n = parts[0].q.shape[1]
        result = JointReference(*(np.empty((time.size, n)) for _ in range(3)))
        for i, part in enumerate(parts):
            for whole, values in zip(result, part, strict=True):
                whole[index == i] = values
        return result

    def _evaluate_one(self, time: float) -> JointReference:
        index = self._index(time)
        return self.stages[index].motion.evaluate(time - self._starts[index])

    def _index(self, time: float) -> int:
        return max(bisect_right(self._starts, time) - 1, 0)


@dataclass(frozen=True, eq=False)
class RampedExcitation:
    """Fourier trajectory with a run-in from rest and a run-out to rest.

    A Fourier trajectory starts with nonzero velocity and acceleration. Reaching them by a
    polynomial would cause an overshoot that grows with the start velocity. Instead the run-in
    follows the trajectory itself: the phase phi(t) starts half a ramp time before zero, and its
    rate rises from 0 to 1 along a quintic step. Posture, velocity and acceleration are
    continuous. All postures of run-in and run-out belong to the checked trajectory, and
    velocities never exceed those of the trajectory.

    Parameters
    ----------
    trajectory : periodic part of the motion.
    periods : number of whole periods at full speed, at least 1.
    ramp_time : positive duration of each ramp [s].

    Raises
    ------
    ExcitationError
        If periods is not a positive integer or the ramp time is not positive.
    """

    trajectory: FourierTrajectory
    periods: int
    ramp_time: float

    def __post_init__(self) -> None:
        if self.periods < 1 or self.periods != int(self.periods):
            raise ExcitationError(
                f'the number of periods must be a positive integer, got {self.periods}'
            )
        if not (np.isfinite(self.ramp_time) and self.ramp_time > 0.0):
            raise ExcitationError(f'ramp time must be positive, got {self.ramp_time} s')

    @property
    def duration(self) -> float:
        """Duration including run-in and run-out [s]."""
        return self.periodic_duration + 2.0 * self.ramp_time

    @property
    def periodic_duration(self) -> float:
        """Duration of the periods between run-in and run-out [s]."""
        return self.periods * self.trajectory.period

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,); before and after, the arm rests."""
        ramp, length = self.ramp_time, self.periodic_duration
        if np.ndim(time) == 0 and ramp <= time <= ramp + length:  # type: ignore[operator]
            return self.trajectory.evaluate(time - ramp)  # type: ignore[operator]
        time = np.asarray(time, dtype=float)
        after_up = time - ramp
        up, down = smooth_step(time / ramp), smooth_step((after_up - length) / ramp)
        # The phase is the integral of its rate, which is up.value in the run-in, 1, and 1 -
        # down.value in the run-out.
        phase = ramp * (up.integral - down.integral - 0.5) + np.minimum(
            np.maximum(after_up, 0.0), length + ramp
        )
        rate = (up.value - down.value)[..., np.newaxis]
        rate_change = ((up.slope - down.slope) / ramp)[..., np.newaxis]
        return self.trajectory.evaluate(phase).paced(rate, rate_change)


@dataclass(frozen=True, eq=False)
class SteadyStroke:
    """Stroke of one joint at constant speed, from rest to rest; all other joints stand still.

    Parameters
    ----------
    start : (n,) initial posture [rad].
    joint : index of the moving joint.
    travel : signed travel of that joint [rad].
    speed : positive constant speed in the middle of the travel [rad/s].
    acceleration : positive largest acceleration of the ramps [rad/s^2].

    Raises
    ------
    ExcitationError
        If the ramps leave no section of constant speed.
    """

    start: Array
    joint: int
    travel: float
    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            raise ExcitationError('speed and acceleration of a stroke must be positive')
        if self.steady_time <= 0.0:
            raise ExcitationError(
                f'a stroke of {abs(self.travel):.3g} rad is too short for {self.speed:.3g} '
                'rad/s, because acceleration and braking together already take '
                f'{self.speed * self.ramp_time:.3g} rad'
            )

    @property
    def ramp_time(self) -> float:
        """Duration of each ramp [s]."""
        return PEAK_SLOPE * self.speed / self.acceleration

    @property
    def steady_time(self) -> float:
        """Time at constant speed [s]; each ramp covers half its duration times the speed."""
        return abs(self.travel) / self.speed - self.ramp_time

    @property
    def duration(self) -> float:
        """Duration of the stroke [s]."""
        return 2.0 * self.ramp_time + self.steady_time

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,); constant outside the duration."""
        t = np.clip(np.asarray(time, dtype=float), 0.0, self.duration)
        ramp, speed = self.ramp_time, np.copysign(self.speed, self.travel)
        up, down = smooth_step(t / ramp), smooth_step((t - self.duration + ramp) / ramp)
        # The integral of the smooth step stays at 1/2 after its end; add the time since the
        # ramp's end.
        steady = np.maximum(t - ramp, 0.0)
        way = ramp * (up.integral - down.integral) + steady
        return JointReference(
            self._of_joint(self.start, speed * way),
            self._of_joint(np.zeros(len(self.start)), speed * (up.value - down.value)),
            self._of_joint(np.zeros(len(self.start)), speed / ramp * (up.slope - down.slope)),
        )

    def _of_joint(self, others: Array, value: ArrayLike) -> Array:
        """Return `others` (n,) with `value`, scalar or (M,), added to the moving joint."""
        value = np.asarray(value)
        whole = np.broadcast_to(others, (*value.shape, len(others))).copy()
        whole[..., self.joint] += value
        return whole
