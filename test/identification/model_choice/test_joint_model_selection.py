"""The candidates of the selection."""

from dataclasses import replace

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identify import IdentificationOptions, identify
from aerarm_ros.identification.joint_model import ROTOR, THESIS_TERMS, JointTerm, TermKind
from aerarm_ros.identification.model_choice.model_choice import (
    CREEP_WIDTHS,
    STRIBECK_WIDTHS,
    WIDTHS,
    candidate_terms,
)
from aerarm_ros.identification.stopwatch import Stopwatch


def test_every_candidate_occurs_once() -> None:
    terms = candidate_terms()
    assert (
        len(set(terms))
        == len(terms)
        == 5 + 2 * len(WIDTHS) + len((*CREEP_WIDTHS, *STRIBECK_WIDTHS))
    )
    assert {*THESIS_TERMS, ROTOR} <= set(terms)


def test_creep_is_slower_than_dry_friction() -> None:
    assert min(CREEP_WIDTHS) > max(WIDTHS)
    assert JointTerm(TermKind.CREEP, CREEP_WIDTHS[0]) in candidate_terms()
    assert max(STRIBECK_WIDTHS) < min(CREEP_WIDTHS)


def chosen_kinds(arm, robot: Robot, config: ArmConfig, extra) -> set[TermKind]:
    """Return what is chosen for joint 3 if `extra(dq)` is added to its torque."""
    bag = arm.recording(1, noise=1.0)
    dq = np.gradient(bag.q[:, 2], bag.time)
    tau = bag.tau.copy()
    tau[:, 2] += extra(dq)
    found = identify(
        robot, config, [replace(bag, tau=tau)], [], IdentificationOptions(), Stopwatch()
    )
    assert found.recommended.estimate.physically_consistent
    return {term.kind for term in found.fit.model.terms[2]}


def test_stribeck_friction_is_noticed(arm, robot: Robot, config: ArmConfig) -> None:
    kinds = chosen_kinds(
        arm, robot, config, lambda dq: 0.4 * np.sign(dq) * np.exp(-((dq / 0.15) ** 2))
    )
    assert TermKind.STRIBECK in kinds


def test_asymmetric_friction_is_noticed(arm, robot: Robot, config: ArmConfig) -> None:
    kinds = chosen_kinds(arm, robot, config, lambda dq: 0.3 * np.maximum(np.sign(dq), 0.0))
    # On a joint that never rests long, half of it looks like an offset, half like Coulomb.
    assert kinds & {TermKind.FORWARD, TermKind.OFFSET}


def test_nothing_is_added_without_need(arm, robot: Robot, config: ArmConfig) -> None:
    kinds = chosen_kinds(arm, robot, config, lambda dq: 0.0 * dq)
    assert not kinds & {TermKind.STRIBECK, TermKind.FORWARD, TermKind.BACKWARD, TermKind.CREEP}
