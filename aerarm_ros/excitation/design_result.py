"""What a design came to."""

from __future__ import annotations

from dataclasses import dataclass

from aerarm_ros.excitation.feasibility_report import FeasibilityReport
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory


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
    """

    trajectory: FourierTrajectory
    quality: Quality
    report: FeasibilityReport
    start: int
    seconds: float
    remark: str = ''
