"""What a design came to."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from aerarm_ros.excitation.feasibility.feasibility_report import FeasibilityReport
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory


@dataclass(frozen=True)
class Quality:
    """How good a trajectory is.

    Parameters
    ----------
    objective : value of the objective, smaller is better.
    condition_number : thesis (5.2), without rotor columns.
    scaled_condition_number : of the base regressor, columns of norm one, rotors included.
    log_deviation : mean logarithm of the standard deviations, see `InformationCriterion`.
    """

    objective: float
    condition_number: float
    scaled_condition_number: float
    log_deviation: float

    def compared_with(self, other: Quality, name: str) -> str:
        """Return how expected standard deviations (geometric mean) compare with `other`'s."""
        gain = exp(other.log_deviation - self.log_deviation)
        if abs(gain - 1.0) < 0.005:
            return f'deviations as large as {name}'
        ratio, word = (gain, 'smaller') if gain >= 1.0 else (1.0 / gain, 'larger')
        return f'deviations {ratio:.2f} times {word} than {name}'


@dataclass(frozen=True)
class DesignResult:
    """A feasible trajectory, how good it is and where it comes from.

    Parameters
    ----------
    trajectory : the Fourier series.
    quality : its figures.
    report : margins to all limits.
    start : number of the random start.
    seconds : time taken [s].
    remark : what became of the optimum, if this is not it.
    stopped : whether the search was stopped before its optimiser came to an end.
    """

    trajectory: FourierTrajectory
    quality: Quality
    report: FeasibilityReport
    start: int
    seconds: float
    remark: str = ''
    stopped: bool = False
