"""What a smooth stop asks of the joints, wherever on a motion it begins."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.feasibility.effort_margins import effort_margins
from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.excitation.feasibility.feasibility_report import LimitMargin, peak_margins
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_motion import JointMotion
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.path_clock import PathClock


class StopChecker:
    """Margins of `PathClock`'s stop to acceleration, torque and motor current.

    A stop keeps the arm on its path, so postures are the motion's own and no joint gets faster.
    But it brakes: the acceleration along the path adds to the motion's. Stops are held to the
    whole limits, not to the share an excitation uses, because they are rare.

    Parameters
    ----------
    limits : the arm's limits, whole.
    effort_model : prior dynamics; None leaves torque and current unchecked.
    stop_time : how long a stop takes [s].

    Raises
    ------
    ExcitationError
        If the stop time is not positive.
    """

    _BEGINNINGS = 0.02
    """Stops are tried this far apart on the motion [s]; 20 ms move the peak by less than 1 %."""
    _INSTANTS = 25
    """Instants looked at in each stop."""

    def __init__(
        self, limits: MotionLimits, effort_model: EffortModel | None, stop_time: float
    ) -> None:
        if not (np.isfinite(stop_time) and stop_time > 0.0):
            raise ExcitationError(f'stop time must be positive, got {stop_time} s')
        self._limits = limits
        self._effort_model = effort_model
        clock = PathClock(stop_time)
        clock.stop(0.0)
        instants = [clock.at(t) for t in np.linspace(0.0, stop_time, self._INSTANTS)]
        self._advance, self._rate, self._rate_change = np.array(instants).T

    def margins(self, motion: JointMotion) -> list[LimitMargin]:
        """Return the margins of all stops on `motion`; their time is when the stop begins."""
        beginnings = np.arange(0.0, motion.duration + self._BEGINNINGS, self._BEGINNINGS)
        beginnings = np.minimum(beginnings, motion.duration)
        states = self._states(motion, beginnings)
        times = np.repeat(beginnings, self._INSTANTS)
        names, limits = self._limits.joint_names, self._limits
        margins = peak_margins(
            'stop acceleration', 'rad/s^2', names, times, states.ddq, limits.acceleration
        )
        if self._effort_model is not None:
            what = ('stop torque', 'stop current')
            margins += effort_margins(what, limits, self._effort_model, times, states)
        return margins

    def _states(self, motion: JointMotion, beginnings: FloatArray) -> JointReference:
        """Return the states of all stops, one stop after the other."""
        along = motion.evaluate(np.add.outer(beginnings, self._advance).ravel())
        rate = np.tile(self._rate, len(beginnings))[:, np.newaxis]
        rate_change = np.tile(self._rate_change, len(beginnings))[:, np.newaxis]
        return along.paced(rate, rate_change)
