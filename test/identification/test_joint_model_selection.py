"""The candidates of the selection."""

from aerarm_ros.identification.joint_model_selection import (
    CREEP_WIDTHS,
    WIDTHS,
    candidate_terms,
)
from aerarm_ros.identification.joint_term import ROTOR, THESIS_TERMS, JointTerm, TermKind


def test_every_candidate_occurs_once() -> None:
    terms = candidate_terms()
    assert len(set(terms)) == len(terms) == 3 + 2 * len(WIDTHS) + len(CREEP_WIDTHS)
    assert {*THESIS_TERMS, ROTOR} <= set(terms)


def test_creep_is_slower_than_dry_friction() -> None:
    assert min(CREEP_WIDTHS) > max(WIDTHS)
    assert JointTerm(TermKind.CREEP, CREEP_WIDTHS[0]) in candidate_terms()
