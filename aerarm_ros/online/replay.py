"""Playback of recordings through the payload estimator."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.payload_estimator import EstimatorSettings, OnlineEstimate, PayloadEstimator

_FOLLOWED = (TermKind.VISCOUS, TermKind.COULOMB, TermKind.LOAD)
_ELSEWHERE = (*_FOLLOWED, TermKind.ROTOR, *COUPLED)


@dataclass(frozen=True, eq=False)
class KnownArm:
    """Model and friction for a `PayloadEstimator`.

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
        """Return the arm that an estimate describes."""
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

    def estimator(self, settings: EstimatorSettings | None = None) -> PayloadEstimator:
        """Return an estimator that starts with this arm."""
        dynamics = MovingBaseDynamics(self.robot, self.rotor_inertia)
        viscous, coulomb, load = self.friction
        return PayloadEstimator(dynamics, viscous, coulomb, load, settings)

    def other_torque(self, dq: Array) -> Array:
        """Return the torque (M, n) of the other terms at velocities (M, n) [Nm]."""
        torque = np.zeros_like(dq)
        for joint, term, value in self.others:
            velocity = dq[:, joint]
            torque[:, joint] += value * term.basis(velocity, velocity, None)
        return torque


_SHORTEST = 1.0  # [s] shortest time of a payload; a shorter event is a knock
_BETWEEN = 1.0  # [s] assumed between two recordings


class LoadChange(NamedTuple):
    """Time at which a payload was detected or released.

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
    """Play recordings of one arm, one after the other, to a `PayloadEstimator`.

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
        """Process a recording, and return the detected payload changes.

        Raises
        ------
        IdentificationError
            If the recording has no velocities, is too short, or yields no estimate.
        """
        if recording.dq is None:
            raise IdentificationError(
                f'{recording.name} has no velocities, which the payload estimator needs: record '
                'them, or estimate the payload with identifier --payload, which differentiates '
                'positions'
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
        return _without_knocks(changes)

    def _check(self, recording: Recording, heard: bool) -> None:
        if self._estimator.problem:
            raise IdentificationError(f'{recording.name}: {self._estimator.problem}')
        if not heard:
            gap = float(np.median(np.diff(recording.time)))
            raise IdentificationError(
                f'{recording.name} is too short or too slow to learn from '
                f'({recording.duration:.2g} s at {1.0 / gap:.3g} Hz): record a longer motion at '
                '25 Hz or more'
            )


def _without_knocks(changes: list[LoadChange]) -> list[LoadChange]:
    """Return the changes without pick-ups that were put down at once."""
    kept: list[LoadChange] = []
    for change in changes:
        last = kept[-1] if kept else None
        if (
            last is not None
            and last.carries
            and not change.carries
            and change.time - last.time < _SHORTEST
        ):
            kept.pop()
        else:
            kept.append(change)
    return kept
