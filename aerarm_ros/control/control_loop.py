"""One cycle of a controller: reference, law, disturbance compensation, limits."""

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
    """Turns state and reference into a command."""

    def take_over(self, q: Array) -> None:
        """Start at the present posture (n,) [rad]."""

    def update(
        self, state: ArmState, reference: Followed, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the command for this cycle of `dt` [s]."""
        ...


Produced = TypeVar('Produced', covariant=True)


class ReferenceSource(Protocol[Produced]):
    """Source of references at each instant."""

    def take_over(self, q: Array) -> None:
        """Start at the present posture (n,) [rad]."""

    def update(self, q: Array, now: float, dt: float) -> Produced:
        """Return the reference at `now` [s], `dt` [s] after the last."""
        ...


Reference = TypeVar('Reference')

# After a longer silence [s] the arm may have been moved by others.
LONGEST_GAP = 0.1
# A command acts from the next cycle on, for one cycle: in its middle [s] after the state.
COMMAND_DELAY = 1.5e-3
# Time [s] in which compensation comes and goes.
_COMPENSATION_FADE = 0.5


class ControlLoop(Generic[Reference]):
    """Everything a controller does between a state and its command.

    Parameters
    ----------
    limits : JointLimits
        Efforts are cut at `effort_max`.
    source : ReferenceSource
    law : ControlLaw
        Of the references that `source` makes.
    observer : MomentumObserver, optional
        It must know the friction that the law compensates.
    base : BaseMotionEstimator or FreeBaseEstimator, optional
        Default: the base is still under the dynamics' own gravity.
    compensation_max : (n,) array_like
        Largest torque [Nm] with which the observed disturbance is compensated; zero only
        observes. A command without effort is left as it is.

    Attributes
    ----------
    compensating : bool
        Whether the disturbance is compensated now, up to `compensation_max`; to be switched
        off while a person guides the arm. It comes and goes smoothly.
    take_overs : int
        How often control began at the arm's posture: at first, and after every gap.
    skipped : int
        States without a command because a number was missing or their time didn't advance.

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
        self._effort_min = -limits.effort_max
        self._fade = Fade(_COMPENSATION_FADE, share=float(self.compensating))
        self._last: float | None = None
        self._has_answered = False  # a state since control began
        self._unobserved: tuple[ArmState, float, float] | None = None
        self.take_overs = 0
        self.skipped = 0

    @property
    def disturbance(self) -> Array | None:
        """Observed disturbance (n,) [Nm], None without observer."""
        return None if self.observer is None else self.observer.residual

    def release(self) -> None:
        """Release the arm; the next state resets the law."""
        self._last = None

    def update(self, state: ArmState, now: float) -> JointCommand | None:
        """Return the command that answers the state of `now` [s], None if there is none.

        Control starts with the second state, which may be of the same time: the first only says
        where the arm is.
        """
        self.observe()
        q, dq, _ = state
        # A sum is NaN or infinite if one of its terms is; of so few, Python's is the quickest.
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
        """Let the observer and the base's estimator take the newest state.

        The next `update` does it otherwise. To call it once the command is sent takes their time
        out of the command's delay; the compensation is a cycle late either way, which a time
        constant of many cycles forgives.
        """
        if self._unobserved is None:
            return
        state, now, dt = self._unobserved
        self._unobserved = None
        if self.base is not None:
            self.base.observe(state, now)
        if self.observer is not None and isfinite(sum(state.tau.tolist())):
            # The torque acted in the cycle that ended with the state. The base at another time
            # would look like a disturbance, and its compensation undo the law's prediction.
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
        """Compensate the disturbance and cut the effort at its limits."""
        q, dq, effort = command
        if effort is None:
            return command
        observer = self.observer
        if observer is not None and (share := self._fade.update(dt, self.compensating)) > 0.0:
            largest = share * self._compensation_max
            effort = effort - np.minimum(np.maximum(observer.residual, -largest), largest)
        effort = np.minimum(np.maximum(effort, self._effort_min), self.limits.effort_max)
        return JointCommand(q, dq, effort)
