"""The candidates of the selection."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.joint_model import ROTOR, THESIS_TERMS, JointTerm, TermKind
from aerarm_ros.identification.model_choice.model_choice import (
    CREEP_WIDTHS,
    DISTANCES,
    STRIBECK_WIDTHS,
    WIDTHS,
    candidate_terms,
)
from aerarm_ros.ros.library.identification import IdentifiedModel


def test_every_candidate_occurs_once() -> None:
    terms = candidate_terms()
    assert (
        len(set(terms))
        == len(terms)
        == 5 + 2 * len((*WIDTHS, *DISTANCES)) + len((*CREEP_WIDTHS, *STRIBECK_WIDTHS))
    )
    assert {*THESIS_TERMS, ROTOR} <= set(terms)


def test_saturating_friction_needs_higher_velocities_than_dry_friction() -> None:
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


def test_friction_that_builds_up_is_noticed_and_predicted(
    make_arm: Callable, robot: Robot, config: ArmConfig
) -> None:
    """Joint 3 has dry friction that builds up over 20 mrad, the others have friction of a step."""
    arm = make_arm()
    bags = []
    for seed in (1, 2):
        bag = arm.recording(seed, noise=1.0)
        tau, state, last = bag.tau.copy(), 1.0, bag.q[0, 2]
        for row, angle in enumerate(bag.q[:, 2]):
            step, last = angle - last, angle
            state += step / 0.02 * (1.0 - state * np.sign(step))
            tau[row, 2] += 0.5 * state
        bags.append(replace(bag, tau=tau))

    def found(friction: str) -> IdentificationResult:
        options = IdentificationOptions(friction=friction)
        return identify(robot, config, bags[:1], bags[1:], options, Stopwatch())

    chosen, step = found('auto'), found('coulomb')
    distances = [max(term.distance for term in own) for own in chosen.fit.model.terms]
    assert distances[2] in DISTANCES
    assert distances[2] >= 0.01
    assert [distances[joint] for joint in (0, 1, 3)] == [0.0, 0.0, 0.0]
    errors = [r.recommended.validation[0].per_joint_filtered[2] for r in (chosen, step)]
    assert errors[0] < 0.5 * errors[1]
    # the same torque from the complete model
    samples = chosen.validation[0].samples
    torque = IdentifiedModel(robot, chosen.recommended.estimate).torque(
        samples.q, samples.dq, samples.ddq, is_motion=True
    )
    assert np.allclose(torque, chosen.recommended.validation[0].prediction.raw)


def test_nothing_is_added_without_need(arm, robot: Robot, config: ArmConfig) -> None:
    kinds = chosen_kinds(arm, robot, config, lambda dq: 0.0 * dq)
    assert not kinds & {TermKind.STRIBECK, TermKind.FORWARD, TermKind.BACKWARD, TermKind.CREEP}
