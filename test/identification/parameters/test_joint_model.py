"""Torque that a joint's own motion causes, and the columns of joint models."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.joint_model import (
    COUPLED,
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
    friction_state,
)
from aerarm_ros.model.regressor import Regressor, viscous_coulomb


def test_columns_are_those_of_the_regressor(robot: Robot) -> None:
    """Whatever the order of the terms, (3.5): links, viscous, Coulomb, then rotors."""
    terms = (ROTOR, *reversed(THESIS_TERMS))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    assert model.columns == Regressor(robot, rotor_inertia=True).columns


DQ = np.linspace(-1.0, 1.0, 41)
DDQ = np.cos(DQ)


@pytest.mark.parametrize('kind', list(TermKind))
def test_friction_dissipates(kind: TermKind) -> None:
    """Friction opposes motion: power dq * tau is never negative."""
    term = JointTerm(kind, 0.1)
    if kind not in (TermKind.ROTOR, TermKind.OFFSET, *COUPLED):
        assert np.all(DQ * term.basis(DQ, DDQ, np.ones(41)) >= 0.0)
    assert term.nonnegative == (kind not in (TermKind.OFFSET, *COUPLED))
    assert term.unit
    assert term.meaning


def test_terms_are_friction_2_6_and_its_parts() -> None:
    """Friction in either direction together is Coulomb friction; load scales dry friction."""
    viscous, coulomb = (term.basis(DQ, DDQ, None) for term in THESIS_TERMS)
    assert np.allclose(0.2 * viscous + 0.3 * coulomb, viscous_coulomb(DQ, 0.2, 0.3))
    kinds = (TermKind.FORWARD, TermKind.BACKWARD, TermKind.COULOMB)
    forward, backward, both = (JointTerm(kind, 0.05).basis(DQ, DDQ, None) for kind in kinds)
    assert np.array_equal(forward + backward, both)
    assert np.all(forward[DQ < 0.0] == 0.0)
    assert np.all(backward[DQ > 0.0] == 0.0)
    load = np.abs(np.sin(3 * DQ))
    assert np.allclose(JointTerm(TermKind.LOAD).basis(DQ, DDQ, load), load * np.sign(DQ))
    with pytest.raises(ValueError, match='needs the argument'):
        JointTerm(TermKind.LOAD).basis(DQ, DDQ, None)


T = np.arange(0.0, 8.0, 1e-3)
PATH = 0.3 * np.sin(T) + 0.1 * np.sin(4.1 * T)
SPEED = 0.3 * np.cos(T) + 0.41 * np.cos(4.1 * T)
DISTANCE = 0.02


def built_up(load: np.ndarray | None = None, kind: TermKind = TermKind.COULOMB) -> np.ndarray:
    travel = np.diff(PATH, prepend=PATH[0])
    state = friction_state(SPEED, travel, DISTANCE)
    return JointTerm(kind, distance=DISTANCE).basis(SPEED, SPEED, load, state)


def test_friction_builds_up_after_a_reversal() -> None:
    state, expected = 1.0, []
    for step in np.diff(PATH, prepend=PATH[0]):
        state += step / DISTANCE * (1.0 - state * np.sign(step))
        expected.append(state)
    assert np.allclose(built_up(), expected, atol=0.02)
    long_after = np.abs(built_up() - np.sign(SPEED)) < 0.05
    assert 0.5 < long_after.mean() < 0.95
    steady = JointTerm(TermKind.COULOMB, distance=DISTANCE)
    assert np.array_equal(steady.basis(SPEED, SPEED, None), np.sign(SPEED))
    load = np.abs(np.sin(T))
    assert np.allclose(built_up(load, TermKind.LOAD), load * built_up())


def test_friction_that_builds_up_returns_no_more_energy_than_it_stored() -> None:
    state = built_up()
    work = np.cumsum(state * np.diff(PATH, prepend=PATH[0]))
    dissipated = work - 0.5 * DISTANCE * (state**2 - 1.0)
    assert np.all(np.diff(dissipated) > -1e-9)


def test_a_sample_without_velocity_does_not_change_the_others() -> None:
    travel = np.diff(PATH, prepend=PATH[0])
    gaps = SPEED.copy()
    gaps[[0, 3000]], travel[[0, 3000, 3001]] = np.nan, np.nan
    state = friction_state(np.column_stack([gaps, SPEED]), np.column_stack([travel] * 2), DISTANCE)
    assert np.flatnonzero(np.isnan(state[:, 0])).tolist() == [0, 3000]
    assert not np.isnan(state[:, 1]).any()
    assert np.nanmax(np.abs(state[:, 0] - built_up())) < 0.05
