"""What is to be designed."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import log

import numpy as np

from aerarm_ros.excitation.design.bounded_criterion import BoundedCriterion
from aerarm_ros.excitation.design.combined_criterion import CombinedCriterion
from aerarm_ros.excitation.design.condition_criterion import ConditionCriterion
from aerarm_ros.excitation.design.design_criterion import DesignCriterion
from aerarm_ros.excitation.design.information_criterion import InformationCriterion
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings.excitation_error import ExcitationError, InfeasibleError
from aerarm_ros.motion.float_array import FloatArray

THESIS, SCALED, INFORMATION, BOTH = 'thesis', 'condition', 'd_optimal', 'both'
OBJECTIVES = {
    BOTH: 'd_optimal, with the condition number (5.2) held below a limit',
    INFORMATION: 'volume of the confidence ellipsoid under torque noise (D-optimality)',
    SCALED: 'condition number of the base regressor with columns of norm one',
    THESIS: 'condition number of the regressor without rotor columns, thesis (5.2)',
}


@dataclass(frozen=True, eq=False)
class DesignSpecification:
    """Trajectory family, objective and arm of a design.

    Parameters
    ----------
    setup : the arm, its limits and surroundings.
    fundamental : f0 [Hz].
    harmonics : N.
    objective : a key of `OBJECTIVES`.
    condition_limit : what `both` holds a smooth upper bound of the condition number (5.2) below;
        the number itself ends about a tenth lower.
    amplitude : largest coefficient of the random trajectories that designs start from [rad].
    noise : (n,) standard deviation of the torque measurement [Nm]; None: 1 % of the effort limit.
    seed : of the starting points.

    Raises
    ------
    ExcitationError, ConfigError
        If a value is out of range.
    InfeasibleError
        If no trajectory can be feasible: N f0 too high, or a centre the arm may not rest at.
    """

    setup: ExcitationSetup
    fundamental: float = 0.1
    harmonics: int = 5
    objective: str = BOTH
    condition_limit: float = 26.0
    amplitude: float = 0.35
    noise: FloatArray | None = field(default=None)
    seed: int = 1

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise ExcitationError(
                f'objective {self.objective!r} is none of {", ".join(OBJECTIVES)}'
            )
        if not self.condition_limit > 1.0:
            raise ExcitationError(f'condition limit must exceed 1, got {self.condition_limit}')
        if self.seed < 0:
            raise ExcitationError(f'the seed must not be negative, got {self.seed}')
        # Its own checks see to amplitude, fundamental and harmonics.
        self.setup.random_trajectory(self.amplitude, self.fundamental, self.harmonics)
        self._require_frequency()
        self.setup.require_bias()

    def _require_frequency(self) -> None:
        checker, highest = self.setup.checker, self.harmonics * self.fundamental
        limits = {
            'half the control rate (sampling limit)': 0.5 / checker.cycle,
            'highest_frequency of the excitation configuration': checker.highest_frequency,
        }
        for name, limit in limits.items():
            if highest > limit * (1.0 + 1e-9):
                raise InfeasibleError(
                    f'frequency of highest harmonic: N f0 = {self.harmonics} x '
                    f'{self.fundamental:g} Hz = {highest:g} Hz exceeds {limit:g} Hz, {name}: '
                    'lower the harmonics or the fundamental'
                )

    def torque_noise(self) -> FloatArray:
        """Return the standard deviation of each joint's torque measurement [Nm], (n,)."""
        if self.noise is not None:
            return self.noise
        effort = self.setup.limits.effort
        return np.where(np.isfinite(effort), 0.01 * effort, 0.1)

    def criterion(
        self,
        thesis: ConditionCriterion,
        scaled: ConditionCriterion,
        optimality: InformationCriterion,
    ) -> DesignCriterion:
        """Return the criterion of the objective, made of the three it is reported by."""
        if self.objective == BOTH:
            # Weight 2: beyond the limit, a tenth more is not worth a tenth less of deviation.
            bounded = BoundedCriterion(thesis, log(self.condition_limit))
            return CombinedCriterion([(1.0, optimality), (2.0, bounded)])
        if self.objective == INFORMATION:
            return optimality
        return scaled if self.objective == SCALED else thesis
