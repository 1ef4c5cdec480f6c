"""Several motions, one after the other."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_motion import JointMotion
from aerarm_ros.motion.joint_reference import JointReference


@dataclass(frozen=True)
class Stage:
    """A named part of a sequence."""

    name: str
    motion: JointMotion


class MotionSequence:
    """Stages played one after the other; a motion itself.

    Parameters
    ----------
    stages : at least one; each has to start where the one before ends, to 1e-9 in position
        [rad], velocity [rad/s] and acceleration [rad/s^2].

    Raises
    ------
    ExcitationError
        If there is no stage, or two stages do not join.
    """

    _JOIN_TOLERANCE = 1e-9

    def __init__(self, stages: Sequence[Stage]) -> None:
        if not stages:
            raise ExcitationError('a motion needs at least one stage')
        for before, after in zip(stages, stages[1:], strict=False):
            self._require_joined(before, after)
        self.stages = tuple(stages)
        durations = [stage.motion.duration for stage in stages]
        self.boundaries: FloatArray = np.concatenate([[0.0], np.cumsum(durations)])
        self._starts: list[float] = self.boundaries[:-1].tolist()

    @classmethod
    def _require_joined(cls, before: Stage, after: Stage) -> None:
        end = before.motion.evaluate(before.motion.duration)
        start = after.motion.evaluate(0.0)
        gap = max(np.abs(e - s).max() for e, s in zip(end, start, strict=True))
        if gap > cls._JOIN_TOLERANCE:
            raise ExcitationError(
                f'stage {after.name} does not start where {before.name} ends (gap {gap:.3g})'
            )

    @property
    def duration(self) -> float:
        """Length of all stages [s]."""
        return float(self.boundaries[-1])

    def stage_at(self, time: float) -> Stage:
        """Return the stage running at `time` [s]."""
        return self.stages[self._index(time)]

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,); the ends hold outside."""
        if np.ndim(time) == 0:
            return self._evaluate_one(float(time))  # type: ignore[arg-type]
        time = np.asarray(time, dtype=float)
        index = np.clip(
            np.searchsorted(self.boundaries, time, side='right') - 1, 0, len(self.stages) - 1
        )
        parts = [
            stage.motion.evaluate(time[index == i] - self.boundaries[i])
            for i, stage in enumerate(self.stages)
        ]
        n = parts[0].q.shape[1]
        result = JointReference(*(np.empty((time.size, n)) for _ in range(3)))
        for i, part in enumerate(parts):
            for whole, values in zip(result, part, strict=True):
                whole[index == i] = values
        return result

    def _evaluate_one(self, time: float) -> JointReference:
        index = self._index(time)
        return self.stages[index].motion.evaluate(time - self._starts[index])

    def _index(self, time: float) -> int:
        return max(bisect_right(self._starts, time) - 1, 0)
