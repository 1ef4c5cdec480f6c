"""Numeric results of an identification for summary.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from aerarm_ros.identification.files.identified_robot import equivalent_friction
from aerarm_ros.identification.identification_result import (
    BagDemand,
    IdentificationResult,
    Solution,
    assess,
)
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.model_fit import BaseParameters
from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.payload import Payload
    from aerarm_ros.identification.truth import InertialTorqueError, Truth


@dataclass(frozen=True)
class ExportError:
    """Torque error of a model with the terms that typical programs read from an exported file.

    Attributes
    ----------
    contents : str
        Parts of the model that the program reads.
    filtered : tuple of float
        Filtered torque error (5.3) [%] on each identification bag, then on each validation bag.
    """

    file: str
    contents: str
    filtered: tuple[float, ...]


def export_errors(result: IdentificationResult) -> list[ExportError]:
    """Return the torque error of each exported model file of an identification.

    Other programs support neither torque offsets nor friction other than (2.6). URDF and SDF
    files cannot store gravity, so they are evaluated with the stated gravity instead of the
    identified one.
    """
    estimate = result.recommended.estimate
    bags = [*result.identification, *result.validation]
    level = _under_stated_gravity(result, bags)
    friction = equivalent_friction(estimate, result.identification)
    rotors = estimate.joint_values(TermKind.ROTOR.value)
    none = np.zeros_like(rotors)
    with_rotors = _simple(estimate, *friction, rotors)
    without = _simple(estimate, *friction, none)

    def errors(model: Estimate, columns: Sequence[SampleColumns]) -> tuple[float, ...]:
        return tuple(bag.filtered for bag in assess(model, columns))

    mujoco, others = errors(with_rotors, bags), errors(without, level)
    drake = mujoco if level is bags else errors(with_rotors, level)
    urdf, sdf, links = 'identified.urdf', 'identified.sdf', 'links, friction (2.6)'
    return [
        ExportError('estimate.yaml', 'whole model (load_identified)', errors(estimate, bags)),
        ExportError('identified.xml', 'MuJoCo: links, rotors, friction (2.6)', mujoco),
        ExportError(urdf, f'Pinocchio and others: {links}', others),
        ExportError(sdf, 'Drake: links, rotors, friction (2.6)', drake),
        ExportError(sdf, f'Gazebo and others: {links}', others),
    ]


def _under_stated_gravity(
    result: IdentificationResult, bags: Sequence[SampleColumns]
) -> Sequence[SampleColumns]:
    if result.gravity.tilt == 0.0:
        return bags
    regressor = Regressor(result.robot.with_gravity(result.gravity.stated))
    return [SampleColumns(bag.samples, regressor) for bag in bags]


def _simple(estimate: Estimate, viscous: Array, coulomb: Array, rotors: Array) -> Estimate:
    """Return the estimate reduced to links, friction of thesis (2.6), and rotor inertia."""
    model = estimate.model
    terms = (*THESIS_TERMS, ROTOR)
    simple = JointModel.uniform(model.joint_names, model.link_names, terms)
    columns = dict(zip(terms, (viscous, coulomb, rotors), strict=True))
    joints = [columns[term][joint] for joint, term in simple.joint_columns]
    theta = np.concatenate([estimate.inertial.ravel(), joints])
    return replace(estimate, model=simple, theta=theta, std=None, determined=None)


@dataclass(frozen=True, eq=False)
class ReportExtras:
    """Contents of summary and report that an `IdentificationResult` does not include.

    Attributes
    ----------
    truth : Truth or None
        True parameters of a simulated arm.
    truth_errors : sequence of InertialTorqueError
        Errors of estimated torques, relative to torques computed with the true parameters.
    payload : Payload or None
        Payload identified from another recording.
    facts : mapping
        Further facts by bag name.
    exports : sequence of ExportError
        Torque errors of each exported file.
    """

    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()
    payload: Payload | None = None
    facts: Mapping[str, BagFacts] = field(default_factory=dict)
    exports: Sequence[ExportError] = ()


def summarise(
    result: IdentificationResult, seconds: Mapping[str, float], extras: ReportExtras
) -> dict[str, Any]:
    """Return the content of summary.json: torque errors in percent, times in seconds.

    Parameters
    ----------
    seconds : mapping
        Time of each stage [s]; their sum is added as 'total'.
    """
    summary: dict[str, Any] = {
        'robot': result.robot.model.name,
        'joints': list(result.robot.joint_names),
        'samples': result.samples,
        'regressor': {
            'thesis': _regressor(result.thesis_base),
            'used': _regressor(result.used_base),
        },
        'base_parameters': result.used_base.expressions(),
        'only_prior': list(result.only_prior),
        'only_in_sums': list(result.only_in_sums),
        'left_out': list(result.left_out),
        'excitation': [_demand(demand) for demand in result.demands],
        'conditioning': _conditioning(result),
        'gravity': _entry(result.gravity, 'stated', 'used', 'tilt'),
        'delays': _delays(result),
        'friction': {
            joint: [term_text(term, result.robot.joint_names) for term in terms]
            for joint, terms in zip(result.robot.joint_names, result.fit.model.terms, strict=True)
        },
        'weights': {bag.samples.name: bag.weights.tolist() for bag in result.identification},
        'seconds': {**seconds, 'total': sum(seconds.values())},
        'solvers': {name: _solver(solution) for name, solution in result.solutions.items()},
        'bags': {name: asdict(known) for name, known in extras.facts.items()},
        'exports': [asdict(error) for error in extras.exports],
        'warnings': list(result.warnings),
    }
    payload = extras.payload
    if payload is not None:
        summary['payload'] = {
            **_entry(payload, 'link', 'mass', 'centre', 'centre_std'),
            'mass_std': float(payload.std[0]),
            'inertial_parameters': payload.inertial.tolist(),
            'inertial_parameters_std': payload.std.tolist(),
        }
    if extras.truth_errors:
        summary['inertial_torque_error'] = [
            {
                **_entry(error, 'solver', 'bag', 'total', 'per_joint'),
                'total_against_true_torque': error.total_absolute,
            }
            for error in extras.truth_errors
        ]
    return summary


def term_text(term: JointTerm, joint_names: Sequence[str]) -> str:
    """Return the description of a term, for example 'Coulomb friction (tanh, 0.05 rad/s)'."""
    if term.driver is not None:
        return f'{term.meaning} {joint_names[term.driver]}'
    if term.distance:
        return f'{term.meaning} (builds up over {term.distance:g} rad after a reversal)'
    shape = 'exp' if term.kind is TermKind.STRIBECK else 'tanh'
    return f'{term.meaning} ({shape}, {term.width:g} rad/s)' if term.width else term.meaning


def _demand(demand: BagDemand) -> dict[str, Any]:
    rows = zip(('q', 'dq', 'ddq'), demand.beyond, strict=True)
    return {
        'bag': demand.bag,
        'beyond_identified_range': {name: row.tolist() for name, row in rows},
        'torque_uncertainty': demand.uncertainty.tolist(),
    }


def _conditioning(result: IdentificationResult) -> dict[str, Any]:
    choice = result.filter_choice
    return {
        **_entry(result.conditioner, 'cutoff', 'fundamental', 'harmonics'),
        'kinematics': choice.kinematics.label,
        'trials': [
            {'cutoff': kinematics.cutoff, 'kinematics': kinematics.label, 'error': error}
            for kinematics, error in choice.trials.items()
        ],
    }


def _delays(result: IdentificationResult) -> dict[str, Any]:
    return {
        **_entry(result.conditioner.delays, 'velocity', 'effort'),
        'velocity_used': result.filter_choice.kinematics.in_time,
        'effort_found': result.delay.found.tolist(),
        'effort_deviation': result.delay.deviation.tolist(),
    }


def _regressor(base: BaseParameters) -> dict[str, Any]:
    return {'columns': len(base.columns), **_entry(base, 'rank', 'condition_number')}


def _solver(solution: Solution) -> dict[str, Any]:
    return {
        'identification': [_entry(bag, *_BAG) for bag in solution.identification],
        'validation': [_entry(bag, *_BAG) for bag in solution.validation],
        **_entry(solution.estimate, *_ESTIMATE),
    }


_ESTIMATE = ('physically_consistent', 'min_pseudo_inertia_eigenvalue', 'seconds')
_ERRORS = ('filtered', 'filtered_measured', 'raw')
_BAG = ('bag', *_ERRORS, *(f'per_joint_{name}' for name in _ERRORS))


def _entry(value: object, *names: str) -> dict[str, Any]:
    """Return selected attributes of an object as a dictionary for JSON."""
    return {name: _plain(getattr(value, name)) for name in names}


def _plain(value: Any) -> Any:
    """Return a value for JSON, with lists for arrays and null for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        return [_plain(one) for one in value.tolist()]
    return None if isinstance(value, float) and not math.isfinite(value) else value
