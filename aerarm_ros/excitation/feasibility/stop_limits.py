"""What a stop on a motion may ask of the joints, wherever it begins."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from aerarm_ros.excitation.feasibility.effort_margins import effort_margins
from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.excitation.feasibility.feasibility_report import LimitMargin
from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_motion import JointMotion
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.path_stop import Row, acceleration_rows

# Where the path itself takes nearly all of a torque limit, a stop still gets this share of the
# path's torque for braking: a stop always ends.
_LEFT = 0.1


class StopLimits:
    """Acceleration, torque and motor current that a stop along a motion keeps, see `stop_along`.

    A stop keeps the arm on its path, so postures are the motion's own and no joint gets faster.
    It brakes as hard as the whole limits allow, not the share an excitation uses, because stops
    are rare. Between full speed and rest the path's own torque lies between that of the motion,
    which is checked, and that of the arm at rest, which `margins` checks.

    Parameters
    ----------
    limits : the arm's limits, whole.
    effort_model : prior dynamics; None leaves torque and current out.
    """

    _RESTS = 0.02
    """The arm may come to rest at postures this far apart on the motion [s]."""

    def __init__(self, limits: MotionLimits, effort_model: EffortModel | None) -> None:
        self.limits = limits
        self._effort_model = effort_model
        self._acceleration_rows = acceleration_rows(limits.acceleration)
        self._effort = limits.effort
        if effort_model is not None:
            self._effort = np.minimum(limits.effort, effort_model.torque(limits.current))

    def rows(self, point: JointReference) -> Iterable[Row]:
        """Return what limits a stop at a point (n,) of the motion, as `stop_along` wants it."""
        rows = [*self._acceleration_rows(point)]
        if self._effort_model is not None:
            rows += self._effort_rows(self._effort_model, point)
        return rows

    def margins(self, motion: JointMotion) -> list[LimitMargin]:
        """Return the margins of holding the arm still wherever on `motion` it was stopped."""
        if self._effort_model is None:
            return []
        times = np.append(np.arange(0.0, motion.duration, self._RESTS), motion.duration)
        rest = JointReference.at_rest(motion.evaluate(times).q)
        what = ('holding torque', 'holding current')
        return effort_margins(what, self.limits, self._effort_model, times, rest)

    def inertial_torque(self, q: FloatArray, ddq: FloatArray) -> FloatArray | None:
        """Return what an acceleration takes at `q` [Nm], within the limits; None without a model.

        All are (n,).
        """
        if self._effort_model is None:
            return None
        zero = np.zeros_like(q)
        moved, still = self._effort_model.effort(
            np.array([q, q]), np.array([zero, zero]), np.array([ddq, zero])
        )
        torque: FloatArray = np.clip(moved - still, -self.limits.effort, self.limits.effort)
        return torque

    def _effort_rows(self, model: EffortModel, point: JointReference) -> Iterable[Row]:
        """Return the rows of each joint's torque; a limit of the current is one of the torque.

        Friction counts as growing with the squared rate. It is larger than that at lower rates,
        which takes load off a motor that brakes.
        """
        zero = np.zeros_like(point.q)
        still, pulled, moved = model.effort(
            np.array([point.q, point.q, point.q]),
            np.array([zero, zero, point.dq]),
            np.array([zero, point.dq, point.ddq]),
        )
        own: FloatArray = np.maximum(np.abs(still), np.abs(moved))
        limit = np.maximum(self._effort, (1.0 + _LEFT) * own)
        columns = (pulled - still, moved - still, still, limit)
        return zip(*(column.tolist() for column in columns), strict=True)
