"""Test bench of flights in which the tool presses on a wall, as processes in lockstep."""

from dataclasses import dataclass

import numpy as np
from flying.holding_bench import HoldingBench, HoldingRecord, path_length, swing
from flying.pushing_case import PushingCase
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message

from aerarm_msgs_py import topics

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
    """

    forces: np.ndarray
    case: PushingCase

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
            along = self.tools[rows, 0]
            return np.nan, peak, np.nan, 1e3 * float((along - along[0]).max())
        rows = self.times > _APPROACH
        error = forces[rows] - case.force
        across = np.linalg.norm((self.tools - self.targets)[rows, 1:], axis=1)
        rms = float(np.sqrt((error**2).mean()))
        return rms, peak, 1e3 * float(np.sqrt((across**2).mean())), np.nan


class PushingBench(HoldingBench):
    """Processes of one case in flight, with a wall ahead of the tool."""

    recorded = (*HoldingBench.recorded, topics.TRUE_WALL_FORCE)
    case: PushingCase

    def push(self, seconds: float) -> PushingRecord:
        """Return the record of approach, push and, if the case has a path, slide."""
        begin, *_, start = self._seen(2.0)[-1]
        self._targets.publish(self._target(start))
        message = WrenchStamped()
        message.header.frame_id = 'odom'
        message.wrench.force.x = self.case.force
        self._pushes.publish(message)
        self._forces: list[float] = []
        self._force = 0.0
        case = self.case
        rows = self._seen(_APPROACH if not case.yields_after else _APPROACH + _YIELD)
        slid = np.zeros(0)
        if not case.yields_after:
            now = rows[-1][0]
            if case.path:
                self._motions.publish(self._path(start, now, seconds))
            more = self._seen(seconds)
            rows = rows + more
            slid = np.array([row[0] for row in more]) - now
        flight = self._record(rows, begin, start)
        if case.path and len(slid):
            flight.targets[-len(slid) :] += swing(slid, path_length(seconds))
        return PushingRecord(**vars(flight), forces=np.array(self._forces), case=case)

    def _row(self, message: Odometry, q: np.ndarray) -> tuple[float, ...]:
        raw = self._reader.take_newest(2)
        if raw is not None:
            self._force = -deserialize_message(raw[0], WrenchStamped).wrench.force.x
        if hasattr(self, '_forces'):
            self._forces.append(self._force)
        return super()._row(message, q)
