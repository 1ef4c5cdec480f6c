"""Torque that a joint's own motion causes."""

import numpy as np
import pytest

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.identification.joint_model import (
    COUPLED,
    ROTOR,
    THESIS_TERMS,
    JointTerm,
    TermKind,
)
from aerarm_ros.model.drive_train import viscous_coulomb

DQ = np.linspace(-1.0, 1.0, 41)
DDQ = np.cos(DQ)


def test_thesis_terms_are_friction_2_6() -> None:
    viscous, coulomb = (term.basis(DQ, DDQ, None) for term in THESIS_TERMS)
    assert np.allclose(0.2 * viscous + 0.3 * coulomb, viscous_coulomb(DQ, 0.2, 0.3))


def test_a_width_makes_the_step_smooth_as_the_compensation_does() -> None:
    smooth = JointTerm(TermKind.COULOMB, 0.05).basis(DQ, DDQ, None)
    compensation = FrictionCompensation([0.0], [0.3], width=0.05)
    assert np.allclose(0.3 * smooth, compensation.torque(DQ))


def test_load_scales_dry_friction_and_is_required() -> None:
    load = np.abs(np.sin(3 * DQ))
    assert np.allclose(JointTerm(TermKind.LOAD).basis(DQ, DDQ, load), load * np.sign(DQ))
    with pytest.raises(ValueError, match='needs the load'):
        JointTerm(TermKind.LOAD).basis(DQ, DDQ, None)


def test_rotor_and_offset() -> None:
    assert np.array_equal(ROTOR.basis(DQ, DDQ, None), DDQ)
    assert np.array_equal(JointTerm(TermKind.OFFSET).basis(DQ, DDQ, None), np.ones(41))


@pytest.mark.parametrize('kind', list(TermKind))
def test_friction_dissipates(kind: TermKind) -> None:
    """Friction opposes motion: power dq * tau is never negative."""
    term = JointTerm(kind, 0.1)
    if kind not in (TermKind.ROTOR, TermKind.OFFSET, *COUPLED):
        assert np.all(DQ * term.basis(DQ, DDQ, np.ones(41)) >= 0.0)
    assert term.nonnegative == (kind not in (TermKind.OFFSET, *COUPLED))
    assert term.unit
    assert term.meaning


def test_stribeck_friction_is_that_of_low_speed() -> None:
    stribeck = JointTerm(TermKind.STRIBECK, 0.1).basis(DQ, DDQ, None)
    fast = np.abs(DQ) > 0.3
    assert np.abs(stribeck[fast]).max() < 2e-4
    assert JointTerm(TermKind.STRIBECK, 0.1).basis(np.array([1e-6, 0.1]), DDQ[:2], None) == (
        pytest.approx([1.0, np.exp(-1.0)])
    )


def test_asymmetric_friction_acts_in_one_direction() -> None:
    """Both parts together are Coulomb friction."""
    forward, backward, both = (
        JointTerm(kind, 0.05).basis(DQ, DDQ, None)
        for kind in (TermKind.FORWARD, TermKind.BACKWARD, TermKind.COULOMB)
    )
    assert np.array_equal(forward + backward, both)
    assert np.all(forward[DQ < 0.0] == 0.0)
    assert np.all(backward[DQ > 0.0] == 0.0)
