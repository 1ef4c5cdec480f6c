"""The way from the motion under way to the one that replaces it, within the limits."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.references.streamed_point import Posture, blend_duration
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.smooth_step import rest_to_rest_duration, smooth_step

Array = npt.NDArray[np.float64]
Evaluate = Callable[[float], JointReference]
Stop = Callable[[float], PolynomialPath]

# Shortest cross-fade [s], instants at which one is computed, and multiples of `blend_duration` that
# it may take.
_SHORTEST = 0.05
_INSTANTS = 40
_MULTIPLES = (1.0, 0.6, 1.7, 0.35, 3.0)
# Samples between two instants, and of the limits, what they may use: a motion that uses all of
# them passes instants that are not its own.
_BETWEEN = 4
_ROUNDING = 1.001
# Of the velocity limits, by how much two motions may differ that are cross-faded as they are.
_ALIKE = 0.1
_RESTING = 1e-6  # [rad/s]
# Of the acceleration limits, what a stop takes that is cross-faded: the rest is for the fade.
_STOP_SHARE = 0.5
# Of the limits, what the way from a stop to the next motion uses.
_WAY_SHARE = 0.5


class FollowedMotion(Protocol):
    """What a follower executes."""

    @property
    def duration(self) -> float:
        """Time from which on it rests at its goal, or brakes [s]."""
        ...

    def evaluate(self, time: float) -> JointReference:
        """Return the reference (n,) at `time` [s]."""
        ...


class Transition:
    """A path that leads to a motion, and the motion from then on.

    Parameters
    ----------
    path : PolynomialPath
        From the present reference on.
    motion : FollowedMotion
    delay : float
        When the motion's time zero is [s], from now.
    """

    def __init__(self, path: PolynomialPath, motion: FollowedMotion, delay: float) -> None:
        self._path, self._motion = path, motion
        self.delay = delay
        self.duration = max(path.duration, delay + motion.duration)

    def evaluate(self, time: float) -> JointReference:
        """Return the reference `time` [s] from now."""
        if time < self._path.duration:
            return self._path.evaluate(time)
        return self._motion.evaluate(time - self.delay)


def find_transition(
    present: Evaluate,
    stop: Stop,
    motion: PolynomialPath | Posture,
    delay: float,
    limits: JointLimits,
) -> Transition:
    """Return how the motion under way goes over into another one, within the limits.

    Both are followed together, with a share of the new one that rises from 0 to 1: no joint leaves
    the range between two motions that keep to the position limits. If the new one begins with
    another velocity, the one under way stops on its path meanwhile. Where no share can rise
    within the limits, the arm stops first and the new motion begins later.

    Parameters
    ----------
    present : callable
        Returns the reference `time` [s] from now, if nothing new comes.
    stop : callable
        Returns the stop of the motion under way, with a share of the acceleration limits.
    motion : PolynomialPath or Posture
        The new one.
    delay : float
        When its time zero is [s], from now; negative in the past.
    limits : JointLimits

    Raises
    ------
    RejectedInputError
        If there is none; the message names the joint and by how much it would exceed its limit.
    """
    old, new = present(0.0), motion.evaluate(-delay)
    deviation = JointReference(*(a - b for a, b in zip(old, new, strict=True)))
    duration = blend_duration(deviation, limits)
    if np.all(np.abs(deviation.dq) <= _ALIKE * limits.velocity_max):
        for multiple in _MULTIPLES:
            path, problem = _cross_fade(present, (), motion, delay, multiple * duration, limits)
            if not problem:
                return Transition(path, motion, delay)
    gentle = stop(_STOP_SHARE)
    for multiple in _MULTIPLES:
        fade = multiple * duration
        path, problem = _cross_fade(gentle.evaluate, gentle.times, motion, delay, fade, limits)
        if not problem:
            return Transition(path, motion, delay)
    return _stop_first(stop(1.0), motion, delay, limits)


def _stop_first(
    stop: PolynomialPath, motion: PolynomialPath | Posture, delay: float, limits: JointLimits
) -> Transition:
    """Return the transition that begins the new motion once the arm rests."""
    rest = stop.evaluate(stop.duration)
    skipped = max(0.0, -delay)
    begin = motion.evaluate(skipped)
    if np.all(np.abs(begin.dq) <= _RESTING):
        path = joined(stop, rest_to_rest_path(rest.q, begin.q, limits))
        return Transition(path, motion, path.duration - skipped)
    deviation = JointReference(*(a - b for a, b in zip(rest, begin, strict=True)))
    duration = blend_duration(deviation, limits)
    problem = ''
    for multiple in _MULTIPLES:
        fade = multiple * duration
        path, problem = _cross_fade(Posture(rest).evaluate, (), motion, -skipped, fade, limits)
        if not problem:
            return Transition(joined(stop, path), motion, stop.duration - skipped)
    raise RejectedInputError(
        f'trajectory: from the present motion to it, {problem}: begin it at rest, or more slowly'
    )


def rest_to_rest_path(start: Array, end: Array, limits: JointLimits) -> PolynomialPath:
    """Return the quintic between two postures (n,) [rad] that uses half of what limits allow."""
    velocity, acceleration = (
        _WAY_SHARE * limits.velocity_max,
        _WAY_SHARE * limits.acceleration_max,
    )
    duration = rest_to_rest_duration(end - start, velocity, acceleration, 0.1)
    return PolynomialPath.rest_to_rest(start, end, duration)


def joined(first: PolynomialPath, second: PolynomialPath) -> PolynomialPath:
    """Return two paths one after the other."""
    times = first.times + tuple(first.duration + time for time in second.times[1:])
    return PolynomialPath(times, np.concatenate([first.coefficients, second.coefficients]))


def _cross_fade(
    source: Evaluate,
    knots: Sequence[float],
    motion: PolynomialPath | Posture,
    delay: float,
    duration: float,
    limits: JointLimits,
) -> tuple[PolynomialPath, str]:
    """Return the path from one motion to the other, and which limit it exceeds, '' if none.

    It passes instants that are evenly spaced, and `knots` [s] of the first motion.
    """
    duration = max(_SHORTEST, duration)
    even = np.linspace(0.0, duration, _INSTANTS + 1)
    within = [knot for knot in knots if 0.0 < knot < duration]
    times = np.unique(np.round(np.concatenate([even, within]), 6))
    old, new = _sampled(source, times), _sampled(motion.evaluate, times - delay)
    share, slope, _, curvature = smooth_step(times[:, np.newaxis] / times[-1])
    slope, curvature = slope / times[-1], curvature / times[-1] ** 2
    ahead, faster = new.q - old.q, new.dq - old.dq
    q = old.q + share * ahead
    dq = old.dq + share * faster + slope * ahead
    ddq = old.ddq + share * (new.ddq - old.ddq) + 2.0 * slope * faster + curvature * ahead
    path = PolynomialPath.quintic(times, q, dq, ddq)
    return path, _exceeded(path.sample(_BETWEEN), limits)


def _exceeded(samples: JointReference, limits: JointLimits) -> str:
    """Return which limit references (M, n) exceed, '' if none."""
    try:
        limits.including(samples.q[0]).check_position('it', samples.q)
    except RejectedInputError as error:
        return str(error)
    for unit, values, limit in (
        ('rad/s', samples.dq, limits.velocity_max),
        ('rad/s^2', samples.ddq, limits.acceleration_max),
    ):
        largest = np.abs(values).max(axis=0)
        joint = int(np.argmax(largest / limit))
        if largest[joint] > _ROUNDING * limit[joint]:
            return (
                f'{limits.names[joint]} would need {largest[joint]:.3g} {unit} '
                f'(limit {limit[joint]:.3g})'
            )
    return ''


def _sampled(evaluate: Evaluate, times: Array) -> JointReference:
    rows = [evaluate(time) for time in times.tolist()]
    return JointReference(*map(np.array, zip(*rows, strict=True)))
