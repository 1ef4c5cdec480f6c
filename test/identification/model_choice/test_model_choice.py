"""Friction models by name and by choice."""

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import TermKind
from aerarm_ros.identification.model_choice.model_choice import (
    FRICTION_MODELS,
    choose_model,
    friction_terms,
)


@pytest.mark.parametrize('name', sorted(FRICTION_MODELS))
def test_named_models_are_fitted_as_they_are(result: IdentificationResult, name: str) -> None:
    fit, comparisons = choose_model(result.robot, result.identification, result.cad, name)
    assert fit.model.terms == (FRICTION_MODELS[name],) * 4
    assert comparisons == []


def test_the_choice_starts_from_the_thesis(result: IdentificationResult) -> None:
    """The simulated arm has viscous and Coulomb friction and rotors: little is added."""
    fit, comparisons = choose_model(result.robot, result.identification, result.cad, 'auto')
    for terms in fit.model.terms:
        kinds = {term.kind for term in terms}
        assert {TermKind.VISCOUS, TermKind.COULOMB, TermKind.ROTOR} <= kinds
    assert len(fit.model.joint_columns) <= 12 + 2
    assert {comparison.joint for comparison in comparisons} == set(range(4))


def test_models_are_combined(result: IdentificationResult) -> None:
    terms = friction_terms('load+stribeck+asymmetric')
    assert len(set(terms)) == len(terms)
    kinds = {TermKind.LOAD, TermKind.STRIBECK, TermKind.FORWARD, TermKind.BACKWARD}
    assert kinds <= {term.kind for term in terms}
    name = 'load+stribeck+asymmetric'
    fit, _ = choose_model(result.robot, result.identification, result.cad, name)
    assert fit.model.terms == (terms,) * 4
    # Under-excited columns are held by their prior: nothing blows up.
    assert np.all(np.abs(fit.theta) < 10.0)


def test_dahl_friction_replaces_the_step_of_all_dry_friction() -> None:
    terms = friction_terms('load+dahl')
    dry = [term for term in terms if term.kind in (TermKind.COULOMB, TermKind.LOAD)]
    assert {term.kind for term in dry} == {TermKind.COULOMB, TermKind.LOAD}
    assert len(dry) == 2
    assert all(term.distance > 0.0 for term in dry)


@pytest.mark.parametrize('name', ['', 'wet', 'load+', 'load+wet'])
def test_unknown_models_are_named(name: str) -> None:
    with pytest.raises(IdentificationError, match='friction model'):
        friction_terms(name)
