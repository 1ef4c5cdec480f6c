"""A motion that was planned, and what is known of it."""

from dataclasses import dataclass

from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.excitation.feasibility.feasibility_report import FeasibilityReport
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.polynomial_path import PolynomialPath


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """A motion from rest to rest within every limit.

    Attributes
    ----------
    path : PolynomialPath
    balance : EnergyBalance
        What it will take.
    report : FeasibilityReport
        Its margins at every control cycle; clearance between them too.
    """

    path: PolynomialPath
    balance: EnergyBalance
    report: FeasibilityReport

    @property
    def goal(self) -> FloatArray:
        """(n,) where it ends [rad]."""
        return self.path.evaluate(self.path.duration).q

    def as_text(self) -> str:
        """Return one line: how long, how much, and which limit is nearest."""
        return (
            f'{self.path.duration:.2f} s, motors {self.balance.motors.sum():.2f} J, nearest limit '
            f'{self.report.binding}'
        )
