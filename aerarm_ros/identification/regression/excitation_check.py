"""Whether a motion says enough about the parameters."""

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.regression.base_parameters import (
    BaseParameters,
    find_base_parameters,
)
from aerarm_ros.identification.regression.reduced_regression import triangular_factor
from aerarm_ros.model.regressor import Regressor

# Gautier and Khalil (1992) ask for less than 100; beyond the limit noise decides.
_POOR_CONDITION = 400.0
_LARGEST_CONDITION = 1000.0
_STATES = 50  # random ones, enough to show every effect that the arm's mechanics has


def excitation_warnings(base: BaseParameters, regressor: Regressor) -> list[str]:
    """Return what is wrong with a motion.

    Parameters
    ----------
    base : BaseParameters
        Of links, viscous and Coulomb friction along the motion.
    regressor : Regressor
        Of the arm, with the same columns.

    Raises
    ------
    IdentificationError
        If the motion excites next to nothing.
    """
    if base.rank == 0:
        raise IdentificationError(
            'the motion excites no parameter: record an excitation trajectory'
        )
    if base.condition_number > _LARGEST_CONDITION:
        raise IdentificationError(
            f'condition number {base.condition_number:.3g}: the motion is too short or too small '
            'to excite the parameters; record a longer one that moves every joint'
        )
    warnings = []
    possible = _structural_rank(regressor)
    if base.rank < possible:
        warnings.append(
            f'the motion identifies only {base.rank} of {possible} parameter combinations; CAD '
            'decides the others: move every joint'
        )
    if base.condition_number > _POOR_CONDITION:
        warnings.append(
            f'condition number {base.condition_number:.0f}: the parameters are poorly excited; '
            'record a longer or livelier motion'
        )
    return warnings


def _structural_rank(regressor: Regressor) -> int:
    """Return the rank that a motion which moves everything gives."""
    random = np.random.default_rng(0)
    states = random.uniform(-2.0, 2.0, (3, _STATES, regressor.robot.n))
    factor = triangular_factor(regressor.stack(*states))
    return find_base_parameters(factor, regressor.columns).rank
