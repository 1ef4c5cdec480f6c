"""A motion that was planned, and what is known of it."""

from dataclasses import dataclass

from aerarm_ros.description.config_reader import check_choice, check_range
from aerarm_ros.energy.energy_model import EnergyBalance
from aerarm_ros.excitation.feasibility import FeasibilityReport
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array


class PlanError(ValueError):
    """Goal that cannot be reached; the message names the binding limit."""


ENERGY, TIME, QUINTIC, DISTURBANCE = OBJECTIVES = ('energy', 'time', 'quintic', 'disturbance')


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Objective of a motion, and usable share of the limits.

    Attributes
    ----------
    objective : str
        'energy': least energy; 'time': the quickest; 'quintic': straight in joint space, for
        comparison; 'disturbance': least peak of the reaction's moment on the base.
    duration : float
        [s]; 0 for as long as is best: where energy is priced, that at which a second more saves
        less than it costs, and for a quintic the shortest.
    time_price : float
        What a second costs besides the arm's energy [W], as the power at which the drone hovers.
    smoothness : float
        Price of acceleration squared, of the joint that moves most inertia [J s^3/rad^2], where
        energy is saved; lighter ones pay more, see `prices_by_lightness`.
    disturbance_price : float
        Price of the reaction's moment on the base, see `DisturbanceTerm` [J/(Nm)^2/s], where energy
        is saved; 0 for none.
    velocity_share, effort_share : float
        Usable share of velocity and acceleration limits, and of torque and current limits.
    knots : int
        Free points of each joint's spline.
    samples : int
        Instants at which a motion is looked at while it is planned.

    Raises
    ------
    ConfigError
        If a value lies outside its range.
    """

    objective: str = ENERGY
    duration: float = 0.0
    time_price: float = 10.0
    smoothness: float = 0.03
    disturbance_price: float = 0.0
    velocity_share: float = 0.9
    effort_share: float = 0.8
    knots: int = 8
    samples: int = 32

    def __post_init__(self) -> None:
        """Check every value."""
        check_choice('plan', 'objective', self.objective, OBJECTIVES)
        check_range('plan', 'duration', self.duration, 0.0, 60.0, 's')
        check_range('plan', 'time_price', self.time_price, 0.0, 1e5, 'W')
        check_range('plan', 'smoothness', self.smoothness, 0.0, 100.0, 'J s^3/rad^2')
        price = self.disturbance_price
        check_range('plan', 'disturbance_price', price, 0.0, 1e6, 'J/(Nm)^2/s')
        for key in ('velocity_share', 'effort_share'):
            check_range('plan', key, getattr(self, key), 0.01, 1.0, '')
        check_range('plan', 'knots', self.knots, 1, 50, '')
        check_range('plan', 'samples', self.samples, 4 * self.knots, 1000, '')


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
    def goal(self) -> Array:
        """(n,) where it ends [rad]."""
        return self.path.evaluate(self.path.duration).q

    def as_text(self) -> str:
        """Return one line: how long, how much, and which limit is nearest."""
        return (
            f'{self.path.duration:.2f} s, motors {self.balance.motors.sum():.2f} J, nearest limit '
            f'{self.report.binding}'
        )
