"""A reference that came as a single point, and what is followed until the next one."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.motion.joint_brake import JointBrake, brake
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.polynomial_path import PolynomialPath

Array = npt.NDArray[np.float64]

_SHORTEST_BLEND = 0.05
# Of a joint's limits, what a blend may use in addition to the motion it is added to.
_SHARE = 0.3
# Multiples of it that are tried, if one leaves the limits.
_MULTIPLES = (1.0, 2.0, 0.5, 4.0)
# How far through its time-out a stream is checked, denser at first: the next point comes soon.
_CHECKED = np.linspace(0.0, 1.0, 17)[:, np.newaxis] ** 2
# Of a braking's travel [-] and of the speed [s], what is kept free before a position limit: the
# braking may begin between two checked instants.
_TRAVEL_RESERVE, _TIME_RESERVE = 0.02, 1e-3


class Posture(NamedTuple):
    """The motion that stays: `reference` at rest."""

    reference: JointReference

    @property
    def duration(self) -> float:
        """Length [s]: none, the posture is the goal from the beginning."""
        return 0.0

    def evaluate(self, time: float) -> JointReference:
        """Return the posture, whatever the time [s]."""
        return self.reference


def blend_duration(deviation: JointReference, limits: JointLimits) -> float:
    """Return the time [s] in which a deviation may go to zero, with a share of the limits."""
    needed = (
        np.abs(deviation.q) / (_SHARE * limits.velocity_max),
        np.sqrt(np.abs(deviation.q) / (_SHARE * limits.acceleration_max)),
        np.abs(deviation.dq) / (_SHARE * limits.acceleration_max),
    )
    # 2: the peak slope of a quintic step is 1.9, the peak curvature after the square root
    # 2.4, and a braking quintic peaks at 1.5 to 2 times its mean.
    return max(_SHORTEST_BLEND, 2.0 * float(np.max(needed)))


class StreamedPoint:
    """The motion that a single point stands for until the next one, and the braking after it.

    The point is extrapolated with constant acceleration. The deviation of the present reference
    from it goes to zero along a quintic, so that the reference never steps. Once the time-out is
    over each joint brakes; earlier, if it would leave a limit or come too near to a position limit
    to stop before it.

    Parameters
    ----------
    point, present : JointReference
        The point, and the reference that it replaces.
    timeout : float
        How long the point may be followed [s].
    limits : JointLimits
    multiple : float
        Of `blend_duration`, how long the quintic takes.

    Attributes
    ----------
    duration : float
        How long the point is followed [s].

    Raises
    ------
    RejectedInputError
        If it cannot be followed at all; the message names the joint and the limit.
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
        """Return the motion with the blend by which the point can be followed for longest.

        Raises
        ------
        RejectedInputError
            If it cannot be followed at all; the message names the joint and the limit.
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
        """Return the reference `time` [s] after the point."""
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
        """Return how long the point can be followed within the limits [s]."""
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
        # The present reference is what it is: another point may still bring it back.
        first_bad = int(np.argmin(good[1:].all(axis=1))) + 1 if not good[1:].all() else len(times)
        if first_bad == 1:
            what = 'streamed point, as it would be followed'
            limits.check_velocity(what, braking.fastest[1])
            limits.check_acceleration(what, ddq[1])
            within.check_position('streamed point: where it can stop', ends[1])
            raise RejectedInputError(f'{what}: it leaves the limits')
        return float(times[first_bad - 1, 0])
