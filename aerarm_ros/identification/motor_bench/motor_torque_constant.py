"""Torque constant of a motor from a hanging known mass."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.motor_bench.motor_friction import MotorFriction
from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

# What the mass adds to gravity's torque must be this many standard deviations.
_SIGNIFICANT = 20.0
_PLAUSIBLE = 2.0  # factor to the stated torque constant


def fit_torque_constant(
    friction: MotorFriction, without: Array | None, known: Array | float, name: str
) -> tuple[float, float]:
    """Return true over stated torque constant, and its standard deviation [-].

    The current says how large the mass's torque is if the stated constant were right; weight
    and lever say how large it is. Gear friction does not enter: it has the same magnitude in
    both directions, gravity's torque the same sign.

    Parameters
    ----------
    friction : MotorFriction
        Fitted with the mass.
    without : (2,) ndarray or None
        Gravity's a and b [Nm] without the mass; None for a bare motor, which carries nothing
        else.
    known : (2,) ndarray or float
        What the mass adds to a and b [Nm]; or, if the lever's angle is not known, m g r.
    name : str
        Of the joint, for errors.

    Raises
    ------
    IdentificationError
        If the mass's torque is too small to measure by, or does not fit its weight.
    """
    added = friction.gravity - (0.0 if without is None else without)
    spread = friction.covariance[3:, 3:] * (1.0 if without is None else 2.0)
    size = float(np.linalg.norm(known))
    direction = added if np.ndim(known) == 0 else np.asarray(known)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    measured = float(added @ direction)
    std = float(np.sqrt(direction @ spread @ direction))
    if size < _SIGNIFICANT * std or size == 0.0:
        raise IdentificationError(
            f'{name}: the mass turns it with {size:.3g} Nm at most, measured to {std:.2g} Nm: '
            'choose a posture in which the mass has a lever about this joint, or a larger mass'
        )
    if not size / _PLAUSIBLE < measured < size * _PLAUSIBLE:
        raise IdentificationError(
            f'{name}: the mass should add {size:.3g} Nm and adds {measured:.3g} Nm: check '
            'mass, position of the mass, and that the result without it is of the same posture'
        )
    ratio = size / measured
    return ratio, ratio * std / measured
