"""Short pieces of a motion, each with the state at its beginning and the torque along it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.conditioning.samples import Samples
from aerarm_ros.identification.conditioning.uniform_motion import sampling_time
from aerarm_ros.identification.recording.recording import Recording

Array = npt.NDArray[np.float64]

_LENGTH = 0.5  # [s]: longer ones say more of small errors, until gravity has carried the arm away
_MOST = 40  # of a bag, evenly spread
# Torque that moves an arm is filtered less than torque that is fitted: dry friction turns round
# within milliseconds.
_CUTOFF = 20.0  # [Hz]
_SAMPLES_PER_CUTOFF = 10.0


@dataclass(frozen=True, eq=False)
class RolloutWindows:
    """W windows of K + 1 samples of an arm's motion.

    Attributes
    ----------
    robot : Robot
        Its kinematics, under its gravity.
    dt : float
        [s]
    q, dq, tau : (W, K + 1, n) ndarray
        [rad], [rad/s], [Nm]
    """

    robot: Robot
    dt: float
    q: Array
    dq: Array
    tau: Array

    @classmethod
    def of(cls, robot: Robot, bags: Sequence[Samples]) -> 'RolloutWindows':
        """Return windows of some motions, all of the first one's sampling time.

        Only those in which every joint's torque is known all along; there may be none.
        """
        dt = float(bags[0].time[1] - bags[0].time[0])
        steps = max(2, round(_LENGTH / dt))
        parts: list[list[Array]] = [[], [], []]
        for samples in bags:
            own = float(samples.time[1] - samples.time[0])
            count = int((len(samples.time) - 1) * own / dt) + 1
            index: Array = np.asarray(dt / own * np.arange(count), dtype=float)
            complete: npt.NDArray[np.bool_] = np.asarray(samples.measured.all(axis=1))
            known = complete[np.rint(index).astype(int)]
            signals = [_at(index, values) for values in (samples.q, samples.dq, samples.tau)]
            starts = np.arange(0, len(index) - steps, steps)
            starts = np.array([s for s in starts if known[s : s + steps + 1].all()], dtype=int)
            starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _MOST)).astype(int)]
            rows = starts[:, None] + np.arange(steps + 1)
            for part, signal in zip(parts, signals, strict=True):
                part.append(signal[rows])
        q, dq, tau = (np.concatenate(part) for part in parts)
        return cls(robot, dt, q, dq, tau)

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.q)


def _at(index: Array, values: Array) -> Array:
    """Return (M, n) values between samples, linearly."""
    places = np.arange(len(values))
    return np.column_stack([np.interp(index, places, column) for column in values.T])


def rollout_samples(conditioner: Conditioner, recording: Recording) -> Samples:
    """Return a recording as rollouts take it: positions as the reference, torque up to 20 Hz.

    Raises
    ------
    IdentificationError
        If the motion in it is too short.
    """
    highest = 1.0 / (_SAMPLES_PER_CUTOFF * sampling_time(recording))
    cutoff = max(conditioner.cutoff, min(_CUTOFF, highest))
    kinematics = KinematicsFilter(cutoff, from_position=True)
    return conditioner.at(cutoff).condition(recording, kinematics, predicted=True)
