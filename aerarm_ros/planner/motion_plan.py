"""Planned motion with predicted energy and margins to the limits, and planner settings."""

from dataclasses import dataclass

from aerarm_ros.description.config_reader import check_choice, check_range
from aerarm_ros.energy.energy_model import EnergyBalance
from aerarm_ros.excitation.feasibility import FeasibilityReport
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array


class PlanError(ValueError):
    """Error for a goal that the arm cannot reach; the message names the violated limit."""


ENERGY, TIME, QUINTIC = OBJECTIVES = ('energy', 'time', 'quintic')


_RANGES = {
    'duration': (0.0, 60.0, 's'),
    'time_price': (0.0, 1e5, 'W'),
    'smoothness': (0.0, 100.0, 'J s^3/rad^2'),
    'velocity_share': (0.01, 1.0, ''),
    'effort_share': (0.01, 1.0, ''),
}


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Planner settings: objective of a motion, and usable fractions of the limits.

    Attributes
    ----------
    objective : str
        'energy': least energy; 'time': shortest duration; 'quintic': straight in joint space, for
        comparison.
    duration : float
        Duration of the motion [s]; 0 lets the planner choose it. If energy is minimized, the
        planner chooses the duration at which a further second saves less energy than
        `time_price`; for a quintic, the shortest duration.
    time_price : float
        Price of a second in addition to the arm's energy [W], for example the drone's hover power.
    smoothness : float
        Price of squared acceleration for the joint with the largest inertia [J s^3/rad^2], if
        energy is minimized; lighter joints have a higher price, see `prices_by_lightness`.
    velocity_share, effort_share : float
        Usable fraction of velocity and acceleration limits, and of torque and current limits.

    Raises
    ------
    ConfigError
        If a value is outside its range.
    """

    objective: str = ENERGY
    duration: float = 0.0
    time_price: float = 10.0
    smoothness: float = 0.03
    velocity_share: float = 0.9
    effort_share: float = 0.8

    def __post_init__(self) -> None:
        """Validate all values."""
        check_choice('plan', 'objective', self.objective, OBJECTIVES)
        for key, (low, high, unit) in _RANGES.items():
            check_range('plan', key, getattr(self, key), low, high, unit)


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """Planned motion from rest to rest, which keeps all limits.

    Attributes
    ----------
    balance : EnergyBalance
        Predicted energy of the motion, by joint and cause.
    report : FeasibilityReport
        Margins at every control cycle; clearance also between cycles.
    """

    path: PolynomialPath
    balance: EnergyBalance
    report: FeasibilityReport

    @property
    def goal(self) -> Array:
        """Final joint positions (n,) [rad]."""
        return self.path.evaluate(self.path.duration).q

    def as_text(self) -> str:
        """Return one line of text: duration, energy, and the limit with the smallest margin."""
        return (
            f'{self.path.duration:.2f} s, motors {self.balance.motors.sum():.2f} J, nearest limit: '
            f'{self.report.binding}'
        )
