"""Recorded motion through the estimator that learns while an arm works."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.online.known_arm import KnownArm
from aerarm_ros.online.online_estimate import OnlineEstimate
from aerarm_ros.online.payload_estimator import PayloadEstimator

_BETWEEN = 1.0  # [s] between two recordings, as far as the estimator knows


class LoadChange(NamedTuple):
    """When something was found to be picked up or put down.

    Attributes
    ----------
    time : float
        Since the recording's beginning [s].
    carries : bool
        Whether something is carried from then on.
    """

    time: float
    carries: bool


class Replay:
    """Plays recordings of one arm, one after the other, to a `PayloadEstimator`.

    The first one begins with an arm that carries nothing. The base stands still.

    Parameters
    ----------
    arm : KnownArm
    estimator : PayloadEstimator
        Made from this arm.
    is_stopped : callable, optional
        Asked now and then; raises KeyboardInterrupt if it says so.

    Attributes
    ----------
    estimate : OnlineEstimate or None
        The last one.
    """

    def __init__(
        self,
        arm: KnownArm,
        estimator: PayloadEstimator,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._arm = arm
        self._estimator = estimator
        self._is_stopped = is_stopped
        self._now = 0.0
        self.estimate: OnlineEstimate | None = None

    def play(self, recording: Recording) -> list[LoadChange]:
        """Go through a recording, and return what was picked up and put down.

        Raises
        ------
        IdentificationError
            If it has no velocities, is too short, or the estimator can tell nothing from it.
        """
        if recording.dq is None:
            raise IdentificationError(
                f'{recording.name}: no velocities: they are taken as they come while an arm works; '
                'record them, or weigh with identifier --payload, which differentiates positions'
            )
        tau = recording.tau - self._arm.other_torque(recording.dq)
        offset = self._now + _BETWEEN - float(recording.time[0])
        carries = self.estimate is not None and self.estimate.carries
        changes, heard = [], False
        rows = zip(recording.time.tolist(), recording.q, recording.dq, tau, strict=True)
        for count, (time, q, dq, torque) in enumerate(rows):
            if count % 1000 == 0 and self._is_stopped():
                raise KeyboardInterrupt
            self._now = time + offset
            told = self._estimator.update(ArmState(q, dq, torque), self._now)
            if told is None:
                continue
            heard, self.estimate = True, told
            if told.carries != carries:
                carries = told.carries
                changes.append(LoadChange(time, carries))
        self._check(recording, heard)
        return changes

    def _check(self, recording: Recording, heard: bool) -> None:
        if self._estimator.problem:
            raise IdentificationError(f'{recording.name}: {self._estimator.problem}')
        if not heard:
            gap = float(np.median(np.diff(recording.time)))
            raise IdentificationError(
                f'{recording.name}: {recording.duration:.2g} s at {1.0 / gap:.3g} Hz are too '
                'little to learn from: give a longer motion, recorded at 25 Hz or more'
            )
