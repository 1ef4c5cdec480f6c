"""Cycle of a controller: reference, control law, disturbance compensation, effort limits."""

from math import isfinite
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.control.checks import JointLimits, non_negative
from aerarm_ros.control.compensation import Fade, MomentumObserver
from aerarm_ros.motion.signals import ArmState, Array, JointCommand

Followed = TypeVar('Followed', contravariant=True)


class ControlLaw(Protocol[Followed]):
    """Interface of a control law, which computes a joint command from state and reference."""

    def take_over(self, q: Array) -> None:
        """Start the control law at the present joint positions q (n,) [rad]."""

    def update(
        self, state: ArmState, reference: Followed, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the joint command for this cycle of `dt` [s]."""
        ...


Produced = TypeVar('Produced', covariant=True)


class ReferenceSource(Protocol[Produced]):
    """Interface of an object that provides the reference of each control cycle."""

    def take_over(self, q: Array) -> None:
        """Start the references at the present joint positions q (n,) [rad]."""

    def update(self, q: Array, now: float, dt: float) -> Produced:
        """Return the reference at `now` [s]; the previous call was `dt` [s] before."""
        ...


Reference = TypeVar('Reference')

# [s] After a longer silence another node may have moved the arm.
LONGEST_GAP = 0.1
# [s] A command acts from the next cycle on, for one cycle; this is the middle of that time.
COMMAND_DELAY = 1.5e-3
# [s] in which compensation fades in and out.
_COMPENSATION_FADE = 0.5


class ControlLoop(Generic[Reference]):
    """Computes a joint command from each joint state: all steps of a controller's cycle.

    Parameters
    ----------
    limits : JointLimits
        Limits of the joints; efforts are clipped at `effort_max`.
    law : ControlLaw
        Control law for the references of `source`.
    observer : MomentumObserver, optional
        Disturbance observer, with the friction that the law compensates.
    base : BaseMotionEstimator or FreeBaseEstimator, optional
        Default: the base is still under the dynamics' own gravity.
    compensation_max : (n,) array_like
        Largest torque [Nm] that compensates the observed disturbance; with zero the disturbance is
        only observed. A command without effort stays unchanged.

    Attributes
    ----------
    compensating : bool
        Whether the disturbance is compensated, up to `compensation_max`; to be switched off while
        a person guides the arm. The compensation fades in and out.
    touched : bool
        Whether the disturbance is a contact, which must not be compensated. The compensation fades
        as above.
    take_overs : int
        Number of times that control began at the arm's posture: at the start, and after every gap.
    skipped : int
        Number of states without a command: a value was not finite, or the time did not advance.

    Raises
    ------
    ValueError
        If `compensation_max` is negative or has another length.
    """

    def __init__(
        self,
        limits: JointLimits,
        source: ReferenceSource[Reference],
        law: ControlLaw[Reference],
        observer: MomentumObserver | None = None,
        base: BaseMotionEstimator | FreeBaseEstimator | None = None,
        compensation_max: npt.ArrayLike = 0.0,
    ) -> None:
        self.limits = limits
        self.source = source
        self.law = law
        self.observer = observer
        self.base = base
        self._compensation_max = non_negative('compensation_max', compensation_max, limits.n)
        self.compensating = bool(np.any(self._compensation_max))
        self.touched = False
        self._effort_min = -limits.effort_max
        self._fade = Fade(_COMPENSATION_FADE, share=float(self.compensating))
        self._last: float | None = None
        self._has_answered = False  # whether a state was answered since control began
        self._unobserved: tuple[ArmState, float, float] | None = None
        self.take_overs = 0
        self.skipped = 0

    @property
    def disturbance(self) -> Array | None:
        """Disturbance torques (n,) [Nm] that the observer estimates; None without an observer."""
        return None if self.observer is None else self.observer.residual

    def release(self) -> None:
        """Stop commanding the arm; the next state resets the law."""
        self._last = None

    def update(self, state: ArmState, now: float) -> JointCommand | None:
        """Return the joint command for the state at `now` [s], None before the second state.

        Control starts with the second state, even at an equal time; the first only provides the
        arm's posture.
        """
        self.observe()
        q, dq, _ = state
        # A sum is NaN or infinite if one of its terms is. For few terms, Python's sum is the
        # fastest.
        if not isfinite(sum(q.tolist()) + sum(dq.tolist())):
            self.skipped += 1
            return None
        if self._last is None or not -LONGEST_GAP < now - self._last < LONGEST_GAP:
            self._take_over(q, now)
            return None
        dt = now - self._last
        if dt < 0.0 or (dt == 0.0 and self._has_answered):
            self.skipped += 1
            return None
        self._last = now
        self._has_answered = True
        base = None if self.base is None else self.base.motion(now, COMMAND_DELAY)
        reference = self.source.update(q, now, dt)
        command = self.law.update(state, reference, dt, base)
        if dt > 0.0:
            self._unobserved = (state, now, dt)
        return self._finish(command, dt)

    def observe(self) -> None:
        """Update disturbance observer and base motion estimator with the newest state.

        Without this call the next `update` also updates observer and estimator. A call after the
        command is sent removes this computation from the command's delay. The compensation is one
        cycle late in both cases, which is short compared with its time constant.
        """
        if self._unobserved is None:
            return
        state, now, dt = self._unobserved
        self._unobserved = None
        if self.base is not None:
            self.base.observe(state, now)
        if self.observer is not None and isfinite(sum(state.tau.tolist())):
            # The torque acted in the cycle that ended with the state. The base's motion at another
            # time would appear as a disturbance, whose compensation would cancel the law's
            # prediction.
            base = None if self.base is None else self.base.motion(now, -0.5 * dt)
            self.observer.update(state, dt, base)

    def _take_over(self, q: Array, now: float) -> None:
        self._last = now
        self._has_answered = False
        self.take_overs += 1
        posture = np.array(q)
        self.source.take_over(posture)
        self.law.take_over(posture)
        self._unobserved = None
        if self.observer is not None:
            self.observer.reset()

    def _finish(self, command: JointCommand, dt: float) -> JointCommand:
        """Subtract the observed disturbance from the effort, and clip the effort at its limits."""
        q, dq, effort = command
        if effort is None:
            return command
        observer = self.observer
        wanted = self.compensating and not self.touched
        if observer is not None and (share := self._fade.update(dt, wanted)) > 0.0:
            largest = share * self._compensation_max
            effort = effort - np.minimum(np.maximum(observer.residual, -largest), largest)
        effort = np.minimum(np.maximum(effort, self._effort_min), self.limits.effort_max)
        return JointCommand(q, dq, effort)
