"""Payload estimation from recordings, by the estimator that also runs online."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.filtered_motion import FilteredMotion, MotionRow
from aerarm_ros.online.payload_estimator import EstimatorSettings, OnlineEstimate, PayloadEstimator

_FOLLOWED = (TermKind.VISCOUS, TermKind.COULOMB, TermKind.LOAD)
_ELSEWHERE = (*_FOLLOWED, TermKind.ROTOR, *COUPLED)


def recorded_states(
    recording: Recording, is_stopped: Callable[[], bool] = lambda: False
) -> Iterator[tuple[float, ArmState]]:
    """Yield times [s] and joint states of a recording.

    Raises
    ------
    IdentificationError
        If the recording has no velocities.
    KeyboardInterrupt
        If `is_stopped`, called from time to time, returns True.
    """
    if recording.dq is None:
        raise IdentificationError(
            f'{recording.name} has no velocities, which this program needs: record velocities with '
            'the positions, or estimate a payload with identifier --payload, which differentiates '
            'positions'
        )
    rows = zip(recording.time.tolist(), recording.q, recording.dq, recording.tau, strict=True)
    for count, (time, *state) in enumerate(rows):
        if count % 1000 == 0 and is_stopped():
            raise KeyboardInterrupt
        yield time, ArmState(*state)


@dataclass(frozen=True, eq=False)
class KnownArm:
    """Rigid-body model and friction of an arm, for a `PayloadEstimator`.

    Attributes
    ----------
    rotor_inertia : (n,) ndarray
        Rotor inertia reflected to the joints [kg m^2].
    friction : (3, n) ndarray
        Viscous [Nms/rad], Coulomb [Nm] and load-dependent friction [-].
    others : tuple of (int, JointTerm, float)
        Joint, term and coefficient of further joint torques.
    """

    robot: Robot
    rotor_inertia: Array
    friction: Array
    others: tuple[tuple[int, JointTerm, float], ...] = ()

    @classmethod
    def identified(cls, robot: Robot, estimate: Estimate) -> 'KnownArm':
        """Return the arm with the parameters of an identification."""
        model = estimate.model
        values = zip(model.joint_columns, estimate.theta[10 * model.n :], strict=True)
        return cls(
            robot.with_inertial_parameters(estimate.inertial),
            estimate.joint_values(TermKind.ROTOR.value),
            np.array([estimate.joint_values(kind.value) for kind in _FOLLOWED]),
            tuple(
                (joint, term, float(value))
                for (joint, term), value in values
                if term.kind not in _ELSEWHERE
            ),
        )

    def estimator(
        self, settings: EstimatorSettings | None = None, torque_noise: Array | None = None
    ) -> PayloadEstimator:
        """Return a `PayloadEstimator` for this arm."""
        dynamics = MovingBaseDynamics(self.robot, self.rotor_inertia)
        viscous, coulomb, load = self.friction
        return PayloadEstimator(dynamics, viscous, coulomb, load, settings, torque_noise)

    def other_torque(self, dq: Array) -> Array:
        """Return the torque (M, n) [Nm] of the model terms `others` at velocities (M, n)."""
        torque = np.zeros_like(dq)
        for joint, term, value in self.others:
            velocity = dq[:, joint]
            torque[:, joint] += value * term.basis(velocity, velocity, None)
        return torque

    def states(
        self, recording: Recording, is_stopped: Callable[[], bool] = lambda: False
    ) -> Iterator[tuple[float, ArmState]]:
        """Return times [s] and joint states of a recording; the torque of `others` is subtracted.

        Raises `IdentificationError` and `KeyboardInterrupt` like `recorded_states`.
        """
        if recording.dq is not None:
            tau = recording.tau - self.other_torque(recording.dq)
            recording = replace(recording, tau=tau)
        return recorded_states(recording, is_stopped)


_DOUBTFUL = 0.1  # of the dry friction: above, its direction is unknown
_MEDIAN = NormalDist().inv_cdf(0.75)  # median of errors, relative to their standard deviation


def unexplained_torque(
    arm: KnownArm,
    recording: Recording,
    bandwidth: float,
    is_stopped: Callable[[], bool] = lambda: False,
) -> Array:
    """Return the RMS (n,) [Nm] of the torque in a recording that the model does not explain.

    The result follows from the median error, without a payload or with the payload that fits best,
    whichever is smaller. Thus neither a payload in the whole recording nor one in a part of it
    counts as noise. Samples in which the direction of dry friction is unknown are omitted.

    Parameters
    ----------
    bandwidth : float
        Bandwidth of the low-passes of the payload estimator [1/s].
    is_stopped : callable, optional
        As for `KnownArm.states`.

    Returns
    -------
    (n,) ndarray
        NaN for joints without such samples.

    Raises
    ------
    IdentificationError
        If the recording has no velocities.
    """
    dynamics = MovingBaseDynamics(arm.robot, arm.rotor_inertia)
    viscous, coulomb, load = arm.friction
    motion = FilteredMotion(dynamics, viscous, coulomb, load, bandwidth)
    doubtful, rows, last = _DOUBTFUL * np.maximum(coulomb, 1e-9), list[MotionRow](), None
    for time, state in arm.states(recording, is_stopped):
        ended = last is not None and motion.update(state, time - last, dynamics.still)
        if ended and motion.is_settled:
            rows.append(motion.row())
        last = time
    if not rows:
        return np.full(dynamics.n, np.nan)
    known = np.array([row.doubt < doubtful for row in rows])
    body = np.array([row.regressor[:, :10] for row in rows])
    torque = np.array([row.torque for row in rows])
    payload, *_ = np.linalg.lstsq(body[known], torque[known], rcond=None)
    medians = np.full((2, dynamics.n), np.nan)
    for median, errors in zip(medians, (torque, torque - body @ payload), strict=True):
        for joint in np.flatnonzero(known.any(axis=0)):
            median[joint] = np.median(np.abs(errors[known[:, joint], joint]))
    return np.asarray(medians.min(axis=0)) / _MEDIAN


_SHORTEST = 1.0  # [s] shortest time of a payload; a shorter event is a knock
_KNOWN = 2.0  # [s] after which the estimator ends a payload that no mass explains
_SIGNIFICANT = 3.0  # standard deviations by which a mass must exceed zero
_BETWEEN = 1.0  # [s] assumed between two recordings


class LoadChange(NamedTuple):
    """Time in a recording at which a payload was picked up or put down.

    Attributes
    ----------
    time : float
        Since the recording's beginning [s].
    carries : bool
        Whether the arm carries a payload from then on.
    """

    time: float
    carries: bool


class Replay:
    """Replay of an arm's recordings, one after the other, with a `PayloadEstimator`.

    The first recording must begin without payload. The base stands still.

    Parameters
    ----------
    estimator : PayloadEstimator
        Estimator of this arm.
    is_stopped : callable, optional
        Called from time to time; if it returns True, KeyboardInterrupt is raised.

    Attributes
    ----------
    estimate : OnlineEstimate or None
        The last estimate.
    knocks : list of float
        Times [s] in the last recording at which torque appeared that no payload explains: a
        contact, or an error of the model.
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
        self.knocks: list[float] = []
        self._is_load = False  # whether a payload explains the torque since the last pick-up

    def play(self, recording: Recording) -> list[LoadChange]:
        """Process a recording; return the times at which the payload changed.

        Raises
        ------
        IdentificationError
            If the recording has no velocities, is too short, or yields no estimate.
        """
        offset = self._now + _BETWEEN - float(recording.time[0])
        carries = self.estimate is not None and self.estimate.carries
        changes, has_estimate = list[LoadChange](), False
        self.knocks = []
        for time, state in self._arm.states(recording, self._is_stopped):
            self._now = time + offset
            estimate = self._estimator.update(state, self._now)
            if estimate is None:
                continue
            has_estimate, self.estimate = True, estimate
            if estimate.carries != carries:
                carries = estimate.carries
                changes.append(LoadChange(time, carries))
                if not carries:
                    self._drop_knock(changes)
                self._is_load = False
            elif carries:
                lasts = estimate.time - estimate.since > _KNOWN
                self._is_load |= (
                    lasts or estimate.payload.mass > _SIGNIFICANT * estimate.payload.std[0]
                )
        self._check(recording, has_estimate)
        return changes

    def _drop_knock(self, changes: list[LoadChange]) -> None:
        """Remove the last payload from `changes` if it was brief or its mass insignificant."""
        begin = changes[-2] if len(changes) > 1 else None
        if begin is None:
            return  # The payload is that of an earlier recording.
        if not self._is_load or changes[-1].time - begin.time < _SHORTEST:
            self.knocks.append(begin.time)
            del changes[-2:]

    def _check(self, recording: Recording, has_estimate: bool) -> None:
        if self._estimator.problem:
            raise IdentificationError(f'{recording.name}: {self._estimator.problem}')
        if not has_estimate:
            gap = float(np.median(np.diff(recording.time)))
            raise IdentificationError(
                f'{recording.name} is too short or too slow to learn from '
                f'({recording.duration:.2g} s at {1.0 / gap:.3g} Hz): record a longer motion at '
                '25 Hz or more'
            )
