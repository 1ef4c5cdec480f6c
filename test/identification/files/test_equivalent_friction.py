"""Viscous and Coulomb friction nearest to a richer model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.files.identified_robot import equivalent_friction
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.solvers.estimate import Estimate


def estimate_with(result: IdentificationResult, **coefficients: float) -> Estimate:
    robot = result.robot
    terms = (*THESIS_TERMS, ROTOR, JointTerm(TermKind.LOAD), JointTerm(TermKind.OFFSET))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    theta = result.cad.vector(model)
    for index, (_, term) in enumerate(model.joint_columns, start=40):
        theta[index] = coefficients.get(term.symbol, 0.0)
    return Estimate('test', model, theta)


def test_plain_friction_stays_as_it_is(result: IdentificationResult) -> None:
    estimate = result.recommended.estimate
    viscous, coulomb = equivalent_friction(estimate, result.identification)
    assert np.array_equal(viscous, estimate.joint_values('fv'))
    assert np.array_equal(coulomb, estimate.joint_values('fs'))


def test_load_becomes_coulomb_friction(result: IdentificationResult) -> None:
    """Of the carrying joint 2 most; rotors and offsets are no friction."""
    plain = estimate_with(result, fv=0.1, fs=0.2, Ja=5.0, fo=3.0)
    viscous, coulomb = equivalent_friction(plain, result.identification)
    assert viscous == pytest.approx([0.1] * 4)
    assert coulomb == pytest.approx([0.2] * 4)
    loaded = estimate_with(result, fv=0.1, fs=0.2, fl=0.1)
    _, more = equivalent_friction(loaded, result.identification)
    bag = result.identification[0]
    load = np.abs(bag.links_torque(loaded.inertial.ravel())).mean(axis=0)
    assert np.argmax(more - coulomb) == np.argmax(load) == 1
    assert more[1] - coulomb[1] == pytest.approx(0.1 * load[1], rel=0.5)


def test_load_dependent_friction_is_not_counted_twice(result: IdentificationResult) -> None:
    """For who knows the load's share; and rounded off or not, Coulomb friction stays what it is."""
    loaded = estimate_with(result, fv=0.1, fs=0.2, fl=0.1)
    viscous, coulomb = equivalent_friction(loaded, result.identification, beside_load=True)
    assert viscous == pytest.approx([0.1] * 4)
    assert coulomb == pytest.approx([0.2] * 4)
    terms = [JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB, 0.05)]
    robot = result.robot
    model = JointModel.uniform(robot.joint_names, robot.link_names, tuple(terms))
    own = [0.1 if term.kind is TermKind.VISCOUS else 0.2 for _, term in model.joint_columns]
    theta = np.concatenate([robot.inertial_parameters.ravel(), own])
    rounded = Estimate('test', model, theta)
    viscous, coulomb = equivalent_friction(rounded, result.identification, beside_load=True)
    assert viscous == pytest.approx([0.1] * 4)
    assert coulomb == pytest.approx([0.2] * 4)


def test_never_negative(result: IdentificationResult, make_arm: Callable) -> None:
    creep = JointTerm(TermKind.CREEP, 0.3)
    robot = result.robot
    model = JointModel.uniform(robot.joint_names, robot.link_names, (creep,))
    theta = np.concatenate([robot.inertial_parameters.ravel(), np.ones(4)])
    estimate = replace(result.recommended.estimate, model=model, theta=theta)
    for values in equivalent_friction(estimate, result.identification):
        assert np.all(values >= 0.0)
