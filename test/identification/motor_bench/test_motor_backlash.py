"""Play of a gear, from swings of a motor whose link flies within it."""

import numpy as np
import pytest
from motor_data import swings

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_backlash import (
    fit_backlash,
    is_largest,
    is_significant,
)
from aerarm_ros.identification.motor_bench.motor_friction import MotorFriction, MotorRun

# As of `swings`.
ROTOR, LINKS = 0.0095, 0.004
VISCOUS, COULOMB, LOAD = 0.006, 0.1, 0.03
GRAVITY = (0.1, -0.02)


def found(run: MotorRun, gravity: tuple[float, float] = GRAVITY) -> tuple[float, float]:
    """Return what is found by who takes the links for lighter and the rotor for heavier."""
    nothing = np.zeros(0)
    friction = MotorFriction(
        VISCOUS, COULOMB, LOAD, np.array(gravity), np.zeros((5, 5)), nothing, nothing
    )
    links, rotor = 0.8 * LINKS, 1.2 * ROTOR
    return fit_backlash([run], friction, (links, 0.2 * links), (rotor, 0.3 * rotor), 'joint')


def test_the_backlash_is_estimated_within_a_tenth() -> None:
    value, std = found(swings(0.02))
    assert value == pytest.approx(0.02, rel=0.1)
    assert abs(value - 0.02) < 3.0 * std < 0.008
    assert not is_largest((value, std))


def test_a_gear_without_backlash_yields_none() -> None:
    value, std = found(swings(0.0))
    assert not is_significant((value, std))
    assert value + 3.0 * std < 3e-3


def test_a_backlash_above_the_search_range_is_reported() -> None:
    assert is_largest(found(swings(0.14, seconds=1.2)))


def test_swings_that_are_too_short_are_refused() -> None:
    with pytest.raises(IdentificationError, match='joint: the oscillations are shorter than 0.5 s'):
        found(swings(0.02, seconds=0.4))
