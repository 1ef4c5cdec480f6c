"""Computation of the fastest stop along a path within limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import sqrt
from typing import NamedTuple

import numpy as np

from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference

# Fractions of the shortest possible braking time. The braking rises within the first fraction at
# the start of the stop, and fades within the second fraction at its end. A stop on a straight
# line thus takes 1.33 times the shortest distance and 1.2 times the shortest time.
RISE, FADE = 0.3, 0.8  # decision 85
# Shortest duration of a stop [s]; a joint that hardly moves stops in a few cycles.
SHORTEST = 0.01
_STEPS = 40  # number of integration steps in the shortest braking time
# Fraction of the limits used at the knots, with a margin for the motion between knots.
_SHARE = 0.98

Row = tuple[float, float, float, float]
"""Coefficients (along, across, still) and limit of a quantity during a stop, such as a torque.
At the path rate r [-] with its derivative r' [1/s] the quantity is `along * r' + across * r^2 +
still`. The absolute value of the quantity must not exceed the limit.
"""
Rows = Callable[[JointReference], Iterable[Row]]


class PathTime(NamedTuple):
    """Path time [s], the point reached on a path; its rate (1 at full speed) and derivative."""

    value: float
    rate: float
    rate_change: float


class PathStop(NamedTuple):
    """Stop along a path: times (K,) [s] since the stop began, and the path times reached then."""

    times: list[float]
    path_times: list[PathTime]

    def clock(self) -> PolynomialPath:
        """Return the path time as a function of the time since the stop began."""
        value, rate, change = np.array(self.path_times).T[..., np.newaxis]
        return PolynomialPath.quintic(self.times, value, rate, change)

    def path(self, motion: Callable[[float], JointReference]) -> PolynomialPath:
        """Return the joints' path that results from this stop along `motion`."""
        rows = [motion(at.value).paced(at.rate, at.rate_change) for at in self.path_times]
        return PolynomialPath.quintic(self.times, *map(np.array, zip(*rows, strict=True)))


def acceleration_rows(acceleration_max: Array) -> Rows:
    """Return a function that yields one `Row` per acceleration limit (n,) [rad/s^2]."""
    limits = acceleration_max.tolist()

    def rows(point: JointReference) -> Iterable[Row]:
        still = [0.0] * len(limits)
        return zip(point.dq.tolist(), point.ddq.tolist(), still, limits, strict=True)

    return rows


def stop_along(motion: Callable[[float], JointReference], begin: float, rows: Rows) -> PathStop:
    """Return the fastest stop along a path that the limits in `rows` allow.

    The path geometry is kept while the rate decreases. The rate's derivative is continuous, so the
    joint accelerations are continuous. The rate never rises, so no joint is faster than on the
    path. A motion that keeps its limits at full rate also keeps them at any lower rate. The
    hardest braking allowed at each point is therefore always possible, and gives the earliest
    stop (lower bound of the rate's derivative in the phase plane: Bobrow, Dubowsky and Gibson,
    1985).

    Parameters
    ----------
    motion : callable
        Function that returns the reference (n,) at a path time [s].
    begin : float
        Path time [s] at the start of the stop.
    rows : callable
        Function that returns the limits at a point of the path.
    """
    point = rows(motion(begin))
    first = [(along, across, still, limit) for along, across, still, limit in point]
    needed = max(max(abs(along) / limit for along, _, _, limit in first), SHORTEST)
    strongest = min(max(-_lowest(first, 1.0), 1.0 / needed), 3.0 / SHORTEST)
    rise, fade = strongest**2 / RISE, 1.0 / (FADE * needed**2)
    step = needed / _STEPS
    time, at = 0.0, PathTime(begin, 1.0, 0.0)
    times, path_times = [time], [at]
    while at.rate > 0.0:
        value, rate, change = at
        last = -2.0 * rate / change if change < 0.0 else np.inf
        if last <= 3.0 * step:  # braking ends at zero speed
            last = max(last, 0.2 * step)
            time, at = time + last, PathTime(value + rate * last / 3.0, 0.0, 0.0)
        else:
            ahead = value + step * (rate + 0.5 * step * change)
            slower = rate + step * change
            lowest = _lowest(rows(motion(ahead)), slower)
            wanted = max(lowest, change - step * rise, -sqrt(2.0 * fade * slower))
            new = min(0.0, wanted)
            value += step * (rate + step * (change / 3.0 + new / 6.0))
            at = PathTime(value, rate + 0.5 * step * (change + new), new)
            time += step
        times.append(time)
        path_times.append(at)
    return PathStop(times, path_times)


def _lowest(rows: Iterable[Row], rate: float) -> float:
    """Return the lowest derivative [1/s] of the path rate that `rows` allow at this path rate."""
    lowest = -10.0 / SHORTEST
    for along, across, still, limit in rows:
        size = abs(along)
        if size > 1e-9:
            beyond = across * rate * rate + still
            left = _SHARE * limit + (beyond if along > 0.0 else -beyond)
            lowest = max(lowest, -left / size)
    return lowest


class JointBrake(NamedTuple):
    """Fastest braking of n joints with continuous acceleration, from states (n,) or (M, n).

    The acceleration changes linearly to its strongest value, stays constant, and fades linearly to
    zero. All signs refer to the direction of motion, and `strongest` is positive for a
    deceleration.

    Attributes
    ----------
    sign : ndarray
        Direction of the motion, -1, 0 or 1.
    speed, rising : ndarray
        Initial speed [rad/s] and its derivative [rad/s^2].
    strongest : ndarray
        Largest deceleration [rad/s^2].
    rise, hold, fade : ndarray
        Durations of the three parts [s].
    """

    sign: Array
    speed: Array
    rising: Array
    strongest: Array
    rise: Array
    hold: Array
    fade: Array

    @classmethod
    def of(cls, dq: Array, ddq: Array, acceleration_max: Array) -> JointBrake:
        """Return the braking that starts with these velocities [rad/s] and accelerations."""
        sign = np.where(dq == 0.0, np.sign(ddq), np.sign(dq))
        speed, rising = np.abs(dq), sign * ddq
        needed = np.maximum(speed / acceleration_max, SHORTEST)
        # An accelerating joint needs a larger change of its acceleration in the same time.
        rise = RISE * needed / (1.0 + np.maximum(rising, 0.0) / acceleration_max)
        fade = FADE * needed
        # Use the deceleration of a stop without a section of constant deceleration, if it is
        # weaker.
        strongest = np.minimum(acceleration_max, (2.0 * speed + rising * rise) / (rise + fade))
        left = speed + 0.5 * (rising - strongest) * rise - 0.5 * strongest * fade
        hold = np.where(strongest < acceleration_max, 0.0, left / acceleration_max)
        return cls(sign, speed, rising, strongest, rise, np.maximum(hold, 0.0), fade)

    @property
    def duration(self) -> Array:
        """Time until each joint is at rest [s]."""
        duration: Array = self.rise + self.hold + self.fade
        return duration

    @property
    def fastest(self) -> Array:
        """Largest speed of each joint [rad/s]; an accelerating joint first becomes faster."""
        rising = np.maximum(self.rising, 0.0)
        change = np.maximum(rising + self.strongest, 1e-9)
        fastest: Array = self.speed + 0.5 * self.rise * rising**2 / change
        return fastest

    @property
    def travel(self) -> Array:
        """Signed travel of each joint until rest [rad]."""
        return self.after(self.duration).q

    def after(self, time: Array) -> JointReference:
        """Return travel, velocity and acceleration of the joints `time` [s] after the start."""
        # Each section in its local time; a section that has not started contributes nothing.
        t1 = np.minimum(time, self.rise)
        t2 = np.minimum(np.maximum(time - self.rise, 0.0), self.hold)
        t3 = np.minimum(np.maximum(time - self.rise - self.hold, 0.0), self.fade)
        change = -(self.strongest + self.rising) / self.rise
        risen = self.speed + t1 * (self.rising + 0.5 * t1 * change)
        held = risen - self.strongest * t2
        fading = self.strongest / self.fade
        travel = (
            t1 * (self.speed + t1 * (0.5 * self.rising + t1 * change / 6.0))
            + t2 * (risen - 0.5 * self.strongest * t2)
            + t3 * (held - t3 * (0.5 * self.strongest - t3 * fading / 6.0))
        )
        dq = held - t3 * (self.strongest - 0.5 * t3 * fading)
        ddq = np.where(time < self.rise, self.rising + t1 * change, t3 * fading - self.strongest)
        return JointReference(self.sign * travel, self.sign * dq, self.sign * ddq)


def brake(start: JointReference, acceleration_max: Array) -> PolynomialPath:
    """Return the motion by which each joint brakes from `start` to rest."""
    braking = JointBrake.of(start.dq, start.ddq, acceleration_max)
    ends = np.cumsum([braking.rise, braking.hold, braking.fade], axis=0).ravel()
    times = np.unique(np.round(np.append(ends, 0.0), 6))[:, np.newaxis]
    travel, dq, ddq = braking.after(times)
    # The joints are exactly at rest at the end, without rounding errors.
    dq[-1] = ddq[-1] = 0.0
    return PolynomialPath.quintic(times[:, 0], start.q + travel, dq, ddq)
