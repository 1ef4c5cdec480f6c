"""How the joints will move in a moment."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.compensation.fade import Fade
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.polynomial_path import PolynomialPath

Array = npt.NDArray[np.float64]

# A plan that the arm is further off [rad], [rad/s] is not what it does.
_POSTURE, _SPEED = 0.3, 1.5
_FADE = 0.05  # [s] between plan and measurement
_LONGEST = 10.0  # [s] of a plan
_TOO_OLD = 0.5  # [s] a plan that begins that long before the newest state is of another time


class ArmForecast:
    """The joints' motion a lead ahead of now: as planned, or else as measured.

    A controller says what it will do in the next moments, and then no observer could be as early.
    From where the arm is, its posture goes on as the plan's does. Without a plan, or with one that
    is not what the arm does, the measured motion serves: the posture goes on with its velocity.
    From one to the other it fades. Times are those of the stamps of joint states [s].

    Parameters
    ----------
    n : int
        Number of joints.
    lead : float
        How far ahead [s].
    """

    def __init__(self, n: int, lead: float = 0.0) -> None:
        self.lead = lead
        self._n = n
        self._path: PolynomialPath | None = None
        self._begin = -np.inf
        self._fade = Fade(_FADE, share=0.0)
        self._time = -np.inf
        self._trust_problem = 'no plan'

    @property
    def problem(self) -> str:
        """Why the plan is not used, '' if it is."""
        return self._trust_problem

    def offer(self, begin: float, times: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Take a plan: points (M, n) at times (M,) after `begin` [s], rising from 0.

        Raises
        ------
        RejectedInputError
            If it has fewer than two points, a number is missing or not finite, or times do not
            rise from 0.
        """
        if q.ndim != 2 or len(times) < 2 or not q.shape == dq.shape == ddq.shape:
            raise RejectedInputError(
                'planned motion: it needs two points or more, each with positions, velocities '
                'and accelerations'
            )
        if q.shape != (len(times), self._n):
            raise RejectedInputError(f'planned motion: each point needs {self._n} joints')
        if not np.isfinite(times.sum() + q.sum() + dq.sum() + ddq.sum()):
            raise RejectedInputError('planned motion: its numbers must be finite')
        if times[0] != 0.0 or np.any(np.diff(times) <= 0.0) or times[-1] > _LONGEST:
            raise RejectedInputError(
                f'planned motion: its times must rise from 0 to {_LONGEST:g} s at most'
            )
        self._path = PolynomialPath.quintic(times, q, dq, ddq)
        self._begin = begin

    def motion(self, now: float, measured: JointReference) -> JointReference:
        """Return the motion at `now + lead` [s] of an arm measured at `now`, (n,) each."""
        step = now - self._time
        self._time = now
        seen = measured.q + self.lead * measured.dq, measured.dq, measured.ddq
        self._trust_problem = self._problem(now, measured)
        if not 0.0 <= step < _TOO_OLD:
            # At first, or after a gap, nothing can jump.
            self._fade.share = 0.0 if self._trust_problem else 1.0
            step = 0.0
        share = self._fade.update(step, not self._trust_problem)
        if share == 0.0 or self._path is None:
            return JointReference(*seen)
        end = (1.0 - 1e-9) * self._path.duration  # at which the motion still goes on
        here = self._path.evaluate(min(now - self._begin, end))
        ahead = self._path.evaluate(min(now + self.lead - self._begin, end))
        planned = measured.q + ahead.q - here.q, ahead.dq, ahead.ddq
        mixed = (share * p + (1.0 - share) * s for p, s in zip(planned, seen, strict=True))
        return JointReference(*mixed)

    def _problem(self, now: float, measured: JointReference) -> str:
        if self._path is None:
            return 'no plan'
        elapsed = now - self._begin
        if elapsed < 0.0 or elapsed + self.lead > self._path.duration:
            if elapsed < -_TOO_OLD or elapsed > self._path.duration + _TOO_OLD:
                self._path = None
            return 'no plan for this time'
        here = self._path.evaluate(elapsed)
        if np.any(np.abs(here.q - measured.q) > _POSTURE):
            return 'the arm is not where it was planned to be'
        if np.any(np.abs(here.dq - measured.dq) > _SPEED):
            return 'the arm does not move as planned'
        return ''
