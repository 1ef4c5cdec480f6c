"""From the present posture through the excitation and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from aerarm_ros.excitation.feasibility.feasibility_checker import FeasibilityChecker
from aerarm_ros.excitation.settings.excitation_error import InfeasibleError
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory.motion_sequence import MotionSequence, Stage
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.excitation.trajectory.transfer import standstill, transfer
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.smooth_step import rest_to_rest_duration

APPROACH, EXCITATION, RETURN = 'approach', 'excitation', 'return'


class ExcitationPlanner:
    """Plans approach, excitation and return, and checks the whole.

    Parameters
    ----------
    checker : limits of the excitation itself.
    transfer_checker : limits of approach and return. Their positions may use the joints' whole
        range, since the arm may rest outside the share an excitation uses.
    ramp_time : run-in and run-out along the trajectory [s].
    transfer_share : share of the transfer checker's velocity and acceleration that transfers use.
    """

    SHORTEST_TRANSFER = 1.0
    """Duration of a transfer between postures that are close to each other [s]."""

    def __init__(
        self,
        checker: FeasibilityChecker,
        transfer_checker: FeasibilityChecker,
        ramp_time: float = 2.0,
        transfer_share: float = 0.3,
    ) -> None:
        self._checker = checker
        self._transfer_checker = transfer_checker
        self._ramp_time = ramp_time
        limits = transfer_checker.limits
        # A model without acceleration limits still has to move in finite time.
        self._velocity = transfer_share * np.minimum(limits.velocity, 10.0)
        self._acceleration = transfer_share * np.minimum(limits.acceleration, 10.0)

    def plan(
        self,
        trajectory: FourierTrajectory,
        periods: int,
        start: FloatArray,
        go_back: bool = True,
    ) -> MotionSequence:
        """Return the motion from rest at `start` through `periods` of the trajectory to rest.

        Parameters
        ----------
        trajectory : periodic part.
        periods : whole number of periods.
        start : (n,) present posture [rad].
        go_back : end at `start` rather than where the run-out ends.

        Raises
        ------
        InfeasibleError
            If the trajectory, the start posture or every way between them breaks a limit.
        """
        self._checker.check_trajectory(trajectory, self._ramp_time, stop_early=True).require(
            'the trajectory'
        )
        self._transfer_checker.check(standstill(start)).require('the start posture')
        excitation = RampedExcitation(trajectory, periods, self._ramp_time)
        first = excitation.evaluate(0.0).q
        last = excitation.evaluate(excitation.duration).q
        stages = self._transfer(APPROACH, start, first, trajectory.q0)
        stages.append(Stage(EXCITATION, excitation))
        if go_back:
            stages += self._transfer(RETURN, last, start, trajectory.q0)
        return MotionSequence(stages)

    def _transfer(
        self, name: str, start: FloatArray, end: FloatArray, centre: FloatArray
    ) -> list[Stage]:
        """Return the first feasible way of the ways tried."""
        refused = None
        for way in _ways(start, end, centre):
            stages = self._stages(name, way)
            report = self._transfer_checker.check(MotionSequence(stages), stop_early=True)
            if report.feasible:
                return stages
            refused = refused or report.binding
        raise InfeasibleError(
            f'no way found for the {name}: {refused}: bring the arm to another posture first'
        )

    def _stages(self, name: str, way: Sequence[FloatArray]) -> list[Stage]:
        stages = []
        for leg, (a, b) in enumerate(pairwise(way)):
            duration = rest_to_rest_duration(
                b - a, self._velocity, self._acceleration, self.SHORTEST_TRANSFER
            )
            way_there = transfer(a, b, duration)
            stages.append(Stage(name if leg == 0 else f'{name} {leg + 1}', way_there))
        return stages


def _ways(start: FloatArray, end: FloatArray, centre: FloatArray) -> Iterator[list[FloatArray]]:
    """Yield straight joint-space ways, then one through the centre, then one joint at a time."""
    yield [start, end]
    yield [start, centre, end]
    for order in (range(len(start)), reversed(range(len(start)))):
        way, posture = [start], start
        for joint in order:
            posture = posture.copy()
            posture[joint] = end[joint]
            way.append(posture)
        yield way
