"""Transition from the present joint motion to the next motion, within the joint limits."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.motion.path_stop import JointBrake, brake
from aerarm_ros.motion.polynomial_path import PolynomialPath, rest_to_rest_duration, smooth_step
from aerarm_ros.motion.signals import Array, JointReference

_SHORTEST_BLEND = 0.05
# Fraction of a joint's limits that a blend may use in addition to its motion.
_SHARE = 0.3
# Multiples of the blend's duration that are tried if one leaves the limits.
_MULTIPLES = (1.0, 2.0, 0.5, 4.0)
# Checked instants as fractions of a stream's time-out, denser at first, because the next point
# arrives soon.
_CHECKED = np.linspace(0.0, 1.0, 17)[:, np.newaxis] ** 2
# Reserve before a position limit, of the braking distance [-] and of the speed [s], because
# braking may begin between two checked instants.
_TRAVEL_RESERVE, _TIME_RESERVE = 0.02, 1e-3


class Posture(NamedTuple):
    """Motion of a resting arm: a constant joint reference."""

    reference: JointReference

    @property
    def duration(self) -> float:
        """Always zero, because the reference is constant [s]."""
        return 0.0

    def evaluate(self, time: float) -> JointReference:
        """Return the constant reference."""
        return self.reference


def blend_duration(deviation: JointReference, limits: JointLimits) -> float:
    """Return the duration [s] of a blend that removes a deviation within part of the limits."""
    needed = (
        np.abs(deviation.q) / (_SHARE * limits.velocity_max),
        np.sqrt(np.abs(deviation.q) / (_SHARE * limits.acceleration_max)),
        np.abs(deviation.dq) / (_SHARE * limits.acceleration_max),
    )
    # The factor 2 covers the peaks of a quintic step: slope 1.9 and, after the square root,
    # curvature 2.4. A braking quintic peaks at 1.5 to 2 times its mean.
    return max(_SHORTEST_BLEND, 2.0 * float(np.max(needed)))


class StreamedPoint:
    """Motion that follows a streamed point until the point's time-out, and then brakes.

    The point is extrapolated with constant acceleration. The deviation of the present reference
    from the extrapolated point goes to zero along a quintic, so that the reference never steps.
    After the time-out each joint brakes. A joint brakes earlier if it would leave a limit, or could
    no longer stop before a position limit.

    Parameters
    ----------
    point, present : JointReference
        The point, and the present reference.
    timeout : float
        Longest time to follow the point [s].
    multiple : float
        Duration of the quintic, in multiples of `blend_duration`.

    Attributes
    ----------
    duration : float
        Time for which the point is followed [s].

    Raises
    ------
    RejectedInputError
        If the point cannot be followed at all; the message names the joint and the limit.
    """

    def __init__(
        self,
        point: JointReference,
        present: JointReference,
        timeout: float,
        limits: JointLimits,
        multiple: float = 1.0,
    ) -> None:
        self._point = point
        self._acceleration_max = limits.acceleration_max
        deviation = JointReference(*(old - new for old, new in zip(present, point, strict=True)))
        self._blend_duration = multiple * blend_duration(deviation, limits)
        ends = [np.array([start, np.zeros_like(start)]) for start in deviation]
        self._blend = PolynomialPath.quintic((0.0, self._blend_duration), *ends)
        self._braking: PolynomialPath | None = None
        self.duration = self._check(timeout, limits)

    @classmethod
    def longest(
        cls, point: JointReference, present: JointReference, timeout: float, limits: JointLimits
    ) -> 'StreamedPoint':
        """Return the motion with the blend that permits to follow the point the longest.

        Raises
        ------
        RejectedInputError
            If the point cannot be followed at all; the message names the joint and the limit.
        """
        best: StreamedPoint | None = None
        for multiple in _MULTIPLES:
            try:
                motion = cls(point, present, timeout, limits, multiple)
            except RejectedInputError as error:
                problem = error
                continue
            if best is None or motion.duration > best.duration:
                best = motion
            if best.duration >= timeout:
                break
        if best is None:
            raise problem
        return best

    def evaluate(self, time: float) -> JointReference:
        """Return the reference `time` [s] after the point was received."""
        if time <= self.duration:
            return self._follow(time)
        if self._braking is None:
            self._braking = brake(self._follow(self.duration), self._acceleration_max)
        return self._braking.evaluate(time - self.duration)

    def _follow(self, time: float) -> JointReference:
        q, dq, ddq = self._point
        followed = JointReference(q + time * (dq + (0.5 * time) * ddq), dq + time * ddq, ddq)
        if time >= self._blend_duration:
            return followed
        rest = self._blend.evaluate(time)
        return JointReference(followed.q + rest.q, followed.dq + rest.dq, followed.ddq + rest.ddq)

    def _check(self, timeout: float, limits: JointLimits) -> float:
        """Return the time [s] for which the point can be followed within the joint limits."""
        times = timeout * _CHECKED
        q, dq, ddq = self._point
        rest = self._blend.evaluate(times[:, 0])
        q = q + times * (dq + (0.5 * times) * ddq) + rest.q
        dq = dq + times * ddq + rest.dq
        ddq = ddq + rest.ddq
        braking = JointBrake.of(dq, ddq, limits.acceleration_max)
        travel = braking.travel
        reserve = _TRAVEL_RESERVE * np.abs(travel)
        ends = q + travel + np.sign(travel) * (reserve + _TIME_RESERVE * np.abs(dq))
        within = limits.including(q[0])
        good = (ends >= within.position_min - 1e-9) & (ends <= within.position_max + 1e-9)
        good &= braking.fastest <= limits.velocity_max + 1e-9
        good &= np.abs(ddq) <= limits.acceleration_max + 1e-9
        # The present reference is exempt, because another point may still bring it back.
        first_bad = int(np.argmin(good[1:].all(axis=1))) + 1 if not good[1:].all() else len(times)
        if first_bad == 1:
            what = 'motion to the streamed point'
            limits.check_velocity(what, braking.fastest[1])
            limits.check_acceleration(what, ddq[1])
            within.check_position('stopping position of the streamed point', ends[1])
            raise RejectedInputError(f'{what}: the motion leaves the limits; slow it down')
        return float(times[first_bad - 1, 0])


Evaluate = Callable[[float], JointReference]
Stop = Callable[[float], PolynomialPath]

# Shortest cross-fade [s], its number of instants, and its duration in multiples of
# `blend_duration`.
_SHORTEST = 0.05
_INSTANTS = 40
_TRIED_MULTIPLES = (1.0, 0.6, 1.7, 0.35, 3.0)
# Checked samples between two instants, and their fraction of the limits: between its instants, a
# motion that uses the whole limits would exceed them.
_BETWEEN = 4
_ROUNDING = 1.001
# Largest velocity difference for a direct cross-fade of two motions, as a fraction of the limits.
_ALIKE = 0.1
_RESTING = 1e-6  # [rad/s]
# Fraction of the acceleration limits for a stop during a cross-fade, which needs the remainder.
_STOP_SHARE = 0.5
# Fraction of the limits for the motion from a stop to the next motion.
_WAY_SHARE = 0.5


class FollowedMotion(Protocol):
    """Interface of a joint motion that a trajectory follower executes."""

    @property
    def duration(self) -> float:
        """Time [s] at which the motion reaches its goal, or begins to brake."""
        ...

    def evaluate(self, time: float) -> JointReference:
        """Return the joint reference at `time` [s] of the motion."""
        ...


class Transition:
    """Motion that begins with a connecting path and continues as another motion.

    Parameters
    ----------
    path : PolynomialPath
        Path from the present reference.
    delay : float
        Time zero of the motion [s], relative to now.
    """

    def __init__(self, path: PolynomialPath, motion: FollowedMotion, delay: float) -> None:
        self._path, self._motion = path, motion
        self.delay = delay
        self.duration = max(path.duration, delay + motion.duration)

    def evaluate(self, time: float) -> JointReference:
        """Return the joint reference at `time` [s] after the transition began."""
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
    """Return a transition from the present motion to another motion, within the limits.

    The transition is a weighted mean, in which the new motion's weight rises from 0 to 1. So no
    joint leaves the range between two motions that respect the position limits. If the new motion
    begins with another velocity, the present one stops on its path meanwhile. If no such
    transition respects the limits, the arm stops first and the new motion begins later.

    Parameters
    ----------
    present : callable
        Returns the reference `time` [s] from now, without new inputs.
    stop : callable
        Returns the stop of the present motion, with a fraction of the acceleration limits.
    motion : PolynomialPath or Posture
        The new motion.
    delay : float
        Time zero of the new motion [s], relative to now; negative in the past.

    Raises
    ------
    RejectedInputError
        If no transition is possible; the message names the joint and by how much it would exceed
        its limit.
    """
    old, new = present(0.0), motion.evaluate(-delay)
    deviation = JointReference(*(a - b for a, b in zip(old, new, strict=True)))
    duration = blend_duration(deviation, limits)
    if np.all(np.abs(deviation.dq) <= _ALIKE * limits.velocity_max):
        path, problem = _cross_fade(present, (), motion, delay, duration, limits)
        if not problem:
            return Transition(path, motion, delay)
    gentle = stop(_STOP_SHARE)
    path, problem = _cross_fade(gentle.evaluate, gentle.times, motion, delay, duration, limits)
    if not problem:
        return Transition(path, motion, delay)
    return _stop_first(stop(1.0), motion, delay, limits)


def _stop_first(
    stop: PolynomialPath, motion: PolynomialPath | Posture, delay: float, limits: JointLimits
) -> Transition:
    """Return a transition in which the arm stops before the new motion begins."""
    rest = stop.evaluate(stop.duration)
    skipped = max(0.0, -delay)
    begin = motion.evaluate(skipped)
    if np.all(np.abs(begin.dq) <= _RESTING):
        path = joined(stop, rest_to_rest_path(rest.q, begin.q, limits))
        return Transition(path, motion, path.duration - skipped)
    deviation = JointReference(*(a - b for a, b in zip(rest, begin, strict=True)))
    duration = blend_duration(deviation, limits)
    path, problem = _cross_fade(Posture(rest).evaluate, (), motion, -skipped, duration, limits)
    if problem:
        raise RejectedInputError(
            f'trajectory: on the way from the present motion, {problem}; begin at rest, or more '
            'slowly'
        )
    return Transition(joined(stop, path), motion, stop.duration - skipped)


def rest_to_rest_path(start: Array, end: Array, limits: JointLimits) -> PolynomialPath:
    """Return the fastest quintic between two postures (n,) [rad] within half of the limits."""
    velocity, acceleration = limits.velocity_max, limits.acceleration_max
    duration = rest_to_rest_duration(
        end - start, _WAY_SHARE * velocity, _WAY_SHARE * acceleration, 0.1
    )
    return PolynomialPath.rest_to_rest(start, end, duration)


def joined(first: PolynomialPath, second: PolynomialPath) -> PolynomialPath:
    """Return one path that consists of two successive paths."""
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
    """Return a cross-fade between two motions, and a text on the limit that it exceeds, or ''.

    The path passes through evenly spaced instants, and through `knots` [s] of the first motion.
    Multiples of `duration` [s] are tried until one respects the limits.
    """
    for multiple in _TRIED_MULTIPLES:
        path = _faded(source, knots, motion, delay, max(_SHORTEST, multiple * duration))
        problem = _exceeded(path.sample(_BETWEEN), limits)
        if not problem:
            break
    return path, problem


def _faded(
    source: Evaluate,
    knots: Sequence[float],
    motion: PolynomialPath | Posture,
    delay: float,
    duration: float,
) -> PolynomialPath:
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
    return PolynomialPath.quintic(times, q, dq, ddq)


def _exceeded(samples: JointReference, limits: JointLimits) -> str:
    """Return a text that names the limit that references (M, n) exceed, or ''."""
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
