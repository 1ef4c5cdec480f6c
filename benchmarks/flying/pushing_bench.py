"""Test bench of flights in which the tool presses on a wall, as processes in lockstep."""

from dataclasses import dataclass

import numpy as np
from flying.holding_bench import HoldingBench, HoldingRecord, path_length, swing
from flying.pushing_case import PushingCase
from geometry_msgs.msg import WrenchStamped

_APPROACH = 4.0  # [s] for approach and rise of the force
_IMPACT = 0.5  # [s] after the first touch
_YIELD = 2.0  # [s] after the wall yields


@dataclass(frozen=True, eq=False, kw_only=True)
class PushingRecord(HoldingRecord):
    """Recorded data of a flight with a wall since the force was sent.

    The targets are those across the force.

    Attributes
    ----------
    forces : (K,) ndarray
        Force on the wall along its normal [N].
    case : PushingCase
    approach : float
        Time for approach and rise of the force [s].
    """

    forces: np.ndarray
    case: PushingCase
    approach: float = _APPROACH

    def figures(self) -> tuple[float, float, float, float]:
        """Return RMS and peak force error [N], error across, and distance of the stop [mm].

        The RMS values exclude approach and rise. A value that does not apply is NaN. The peak is
        the largest force within 0.5 s after the first touch.
        """
        case, forces = self.case, self.forces
        touches = np.flatnonzero(forces > 0.0)
        if not len(touches):
            return np.nan, np.nan, np.nan, np.nan
        touched = self.times[touches[0]]
        peak = float(forces[(self.times < touched + _IMPACT)].max())
        if case.yields_after:
            rows = self.times >= touched + case.yields_after
            along = self.tool_places[rows, 0]
            return np.nan, peak, np.nan, 1e3 * float((along - along[0]).max())
        rows = self.times > self.approach
        error = forces[rows] - case.force
        across = np.linalg.norm((self.tool_places - self.targets)[rows, 1:], axis=1)
        rms = float(np.sqrt((error**2).mean()))
        return rms, peak, 1e3 * float(np.sqrt((across**2).mean())), np.nan


class PushingBench(HoldingBench):
    """Processes of one case in flight, with a wall ahead of the tool."""

    case: PushingCase

    def push(
        self, seconds: float, settling: float = 2.0, approach: float = _APPROACH
    ) -> PushingRecord:
        """Return the record of approach, push and, if the case has a path, slide."""
        begin, start = self._begin(settling)
        self._targets.publish(self._target(start))
        message = WrenchStamped()
        message.header.frame_id = 'odom'
        message.wrench.force.x = self.case.force
        self._pushes.publish(message)
        case = self.case
        flight = self.seen(approach + _YIELD if case.yields_after else approach)
        now = float(flight.times[-1])
        if not case.yields_after:
            if case.path:
                self._motions.publish(self._path(start, now, seconds))
            flight = self.seen(seconds, is_new=False)
        stamps, forces = np.array(self.listener.forces).T
        record = self._record(flight, begin, start)
        if case.path:
            slides = flight.times > now
            record.targets[slides] += swing(flight.times[slides] - now, path_length(seconds))
        felt = np.interp(flight.times, stamps, forces)
        return PushingRecord(**vars(record), forces=felt, case=case, approach=approach)
