"""Whether a motion keeps every limit, from its first to its last control cycle."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.clearance.clearance_checker import Clearance, ClearanceChecker
from aerarm_ros.excitation.feasibility.effort_margins import effort_margins
from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.excitation.feasibility.feasibility_report import (
    FeasibilityReport,
    LimitMargin,
    peak_margins,
)
from aerarm_ros.excitation.feasibility.stop_limits import StopLimits
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_motion import JointMotion
from aerarm_ros.motion.joint_reference import JointReference


class FeasibilityChecker:
    """Checks motions against joint limits, torque, motor current and clearance.

    A motion is evaluated at every control cycle, which is all that is ever commanded. Between
    two cycles a joint moves beyond both by at most ddq_max cycle^2 / 8 (2e-6 rad at 15 rad/s^2
    and 1 kHz), less than any limit is known to. Clearance is certified between cycles too.

    Parameters
    ----------
    limits : what the joints may do.
    clearance : distances to keep; None leaves collisions unchecked.
    effort_model : prior dynamics, for torque and current; None leaves them unchecked.
    highest_frequency : highest harmonic a trajectory may have [Hz], below what shakes the arm's
        elastic parts.
    cycle : control cycle [s].
    stops : checks that the arm may rest anywhere on the motion; None leaves that unchecked.

    Raises
    ------
    ExcitationError
        If the cycle cannot carry the highest frequency (Nyquist, thesis 3.4.2).
    """

    _GLANCE = 25
    """Every how many cycles a motion is looked at first."""

    def __init__(
        self,
        limits: MotionLimits,
        clearance: ClearanceChecker | None = None,
        effort_model: EffortModel | None = None,
        highest_frequency: float = 2.0,
        cycle: float = 1e-3,
        stops: StopLimits | None = None,
    ) -> None:
        if not 0.0 < highest_frequency < 0.5 / cycle:
            raise ExcitationError(
                f'the highest frequency must lie between 0 and half the control rate '
                f'({0.5 / cycle:g} Hz), got {highest_frequency} Hz'
            )
        self.highest_frequency = highest_frequency
        self.limits = limits
        self.clearance = clearance
        self.effort_model = effort_model
        self.cycle = cycle
        self._stops = stops

    def check_trajectory(
        self, trajectory: FourierTrajectory, ramp_time: float, stop_early: bool = False
    ) -> FeasibilityReport:
        """Return the margins of one period of a trajectory with run-in and run-out.

        More periods repeat the same postures, so one stands for all. Parameters as in `check`;
        `ramp_time` [s] as in `RampedExcitation`.
        """
        reached, allowed = trajectory.highest_frequency, self.highest_frequency
        harmonic = LimitMargin(
            'frequency', 'highest harmonic', reached, allowed, allowed - reached,
            1.0 - reached / allowed, 'Hz', 0.0,
        )  # fmt: skip
        if stop_early and not FeasibilityReport([harmonic]).feasible:
            return FeasibilityReport([harmonic])
        report = self.check(RampedExcitation(trajectory, 1, ramp_time), stop_early)
        return FeasibilityReport([harmonic, *report.margins], report.notes)

    def check(self, motion: JointMotion, stop_early: bool = False) -> FeasibilityReport:
        """Return the margins of `motion` to every limit.

        Parameters
        ----------
        motion : what is checked, from 0 to its duration.
        stop_early : look at a few samples first, and leave the rest out once a limit is broken.
        """
        cycles = int(np.ceil(motion.duration / self.cycle))
        times = np.linspace(0.0, motion.duration, cycles + 1)
        if stop_early:
            coarse = times[:: self._GLANCE]
            glance = FeasibilityReport(self._joint_margins(coarse, motion.evaluate(coarse)))
            if not glance.feasible:
                return glance
        states = motion.evaluate(times)
        near: list[LimitMargin] = []
        if self.clearance is not None:
            found = self.clearance.sweep(states.q, stop_below=stop_early)
            near = [_clearance_margin(kind, c, times) for kind, c in found.items()]
        if stop_early and not FeasibilityReport(near).feasible:
            return FeasibilityReport(near)
        margins = [*self._joint_margins(times, states), *near]
        if self._stops is not None:
            margins += self._stops.margins(motion)
        return FeasibilityReport(margins, self.clearance.notes if self.clearance else ())

    def _joint_margins(self, times: FloatArray, states: JointReference) -> list[LimitMargin]:
        position, velocity, acceleration = states
        margins = self._position_margins(times, position)
        names, limits = self.limits.joint_names, self.limits
        margins += peak_margins('velocity', 'rad/s', names, times, velocity, limits.velocity)
        margins += peak_margins(
            'acceleration', 'rad/s^2', names, times, acceleration, limits.acceleration
        )
        if self.effort_model is not None:
            what = ('torque', 'motor current')
            margins += effort_margins(what, limits, self.effort_model, times, states)
        return margins

    def _position_margins(self, times: FloatArray, position: FloatArray) -> list[LimitMargin]:
        low, high = self.limits.position_min, self.limits.position_max
        margins = []
        for j, name in enumerate(self.limits.joint_names):
            at_low, at_high = int(position[:, j].argmin()), int(position[:, j].argmax())
            for sample, bound, sign in ((at_low, low[j], 1.0), (at_high, high[j], -1.0)):
                if np.isfinite(bound):
                    reached = float(position[sample, j])
                    margin = sign * (reached - float(bound))
                    # Half the range: the most margin that can be had on both sides.
                    half = 0.5 * float(min(high[j] - low[j], 2.0 * np.pi))
                    margins.append(
                        LimitMargin(
                            'position',
                            name,
                            reached,
                            float(bound),
                            margin,
                            margin / half,
                            'rad',
                            float(times[sample]),
                        )
                    )
        return margins


def _clearance_margin(kind: str, found: Clearance, times: FloatArray) -> LimitMargin:
    margin = found.guaranteed - found.required
    # Compared with 0.1 m: the distance at which an arm of this size counts as free.
    return LimitMargin(
        f'{kind} clearance',
        found.subject,
        found.guaranteed,
        found.required,
        margin,
        margin / 0.1,
        'm',
        float(times[found.sample]),
    )
