"""Plausibility checks of the input of an identification: signs, units, gravity, bounds."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.assessment import BagAssessment
from aerarm_ros.identification.identification_result import Solution
from aerarm_ros.identification.input_errors import torque_factors
from aerarm_ros.identification.joint_model import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import MASS_FACTOR, Estimate
from aerarm_ros.motion.signals import Array

# Torque error [%] above which the CAD model contradicts the input. A prediction of zero torque
# has the error 100 %; efforts in a much smaller unit give almost 100 %.
_USELESS = 90.0
# The semidefinite program normally increases the least torque error by a few per cent only.
_FAR_ABOVE = 3.0
_LARGE = 10.0  # [%]
_OTHER_UNIT = 5.0  # largest plausible ratio of measured and modelled torque
_AT_BOUND = 0.01  # relative distance from its bound, below which a mass counts as at the bound
_CLEARLY_NEGATIVE = 3.0  # standard deviations

# [%] residual relative to the joint's torque, above which the model explains little
_FAR_OFF = 20.0
_FOLLOWS = 0.5  # fraction of a joint's residual that the motion of another joint must explain

_CHECK = (
    'check sign and unit of the effort (--effort-gain JOINT=Nm/A, or =-1), gravity (--gravity), '
    'the topic, and the joint names (--rename)'
)


def error_warnings(
    solutions: Mapping[str, Solution],
    bags: list[SampleColumns],
    cad: ArmParameters,
    joints: tuple[str, ...],
) -> list[str]:
    """Return warnings about probably wrong input, from the torque errors of the solvers.

    Parameters
    ----------
    solutions : mapping
        Solutions by solver, including those of `solvers.ALWAYS`.
    bags : list of SampleColumns
        Identification bags.
    """
    drawn, ols, sdp = (
        float(np.mean([bag.filtered for bag in solutions[name].identification]))
        for name in ('cad_friction', 'ols', 'sdp')
    )
    warnings = []
    if drawn > _USELESS:
        suspects = _suspects(bags, cad, joints)
        hint = f' ({"; ".join(suspects)})' if suspects else ''
        warnings.append(
            'the CAD model with identified friction differs from the measured torque by '
            f'{drawn:.0f} %{hint}: {_CHECK}'
        )
    if sdp > max(_LARGE, _FAR_ABOVE * ols):
        warnings.append(
            f'a physically consistent model leaves {sdp:.1f} % of the torque unexplained, but '
            f'unconstrained least squares only {ols:.1f} %, so an input must be wrong: {_CHECK}'
        )
    return warnings


def joint_warnings(recommended: Solution, joints: tuple[str, ...]) -> list[str]:
    """Return warnings about joints whose torque the model barely explains."""
    warnings = []
    errors, predicted = (
        _joint_errors(part, len(joints))
        for part in (recommended.identification, recommended.validation)
    )
    if far_off := _shares(joints, errors, errors > _FAR_OFF):
        warnings.append(
            f'the model explains little of the torque of some joints (residual {far_off}): do '
            'not rely on their friction and on parameters that only these joints identify'
        )
    if far_off := _shares(joints, predicted, (predicted > _FAR_OFF) & (errors <= _FAR_OFF)):
        warnings.append(
            'the model predicts little of the torque of some joints in validation (residual '
            f'{far_off}): compare the ranges of both motions in the report'
        )
    return warnings


def coupling_warnings(
    recommended: Solution, bags: list[SampleColumns], joints: tuple[str, ...]
) -> list[str]:
    """Return warnings about joints whose residual follows another joint's motion.

    Parameters
    ----------
    bags : list of SampleColumns
        Identification bags.
    """
    warnings = []
    errors = _joint_errors(recommended.identification, len(joints))
    for joint, (driver, share) in _followed(recommended, bags).items():
        if driver is not None and share > _FOLLOWS and errors[joint] > _LARGE:
            pair = f'{joints[joint]}={joints[driver]}'
            warnings.append(
                f'the residual of {joints[joint]} follows the velocity or acceleration of '
                f'{joints[driver]} ({100.0 * share:.0f} % of it): if one drive passes the other '
                f'joint, pass --coupled {pair}'
            )
    return warnings


def _joint_errors(bags: list[BagAssessment], n: int) -> Array:
    """Return the largest torque error of each joint over all bags [%]; 0 without bags."""
    return np.asarray(np.fmax.reduce([np.zeros(n), *(bag.per_joint_filtered for bag in bags)]))


def _shares(joints: tuple[str, ...], errors: Array, reported: npt.NDArray[np.bool_]) -> str:
    named = zip(joints, errors, reported, strict=True)
    return ', '.join(f'{name} {error:.0f} %' for name, error, is_reported in named if is_reported)


def _followed(
    recommended: Solution, bags: list[SampleColumns]
) -> dict[int, tuple[int | None, float]]:
    """Return, per joint, the joint whose motion best explains its residual, and the fraction."""
    n = bags[0].samples.n
    couplings = {(k, kind): JointTerm(kind, driver=k) for k in range(n) for kind in COUPLED}
    found: dict[int, tuple[int | None, float]] = {}
    for joint in range(n):
        rows = [bag.samples.usable[:, joint] for bag in bags]
        pairs = list(zip(bags, recommended.identification, rows, strict=True))
        residual = np.concatenate(
            [(b.samples.tau - a.prediction.filtered)[row, joint] for b, a, row in pairs]
        )
        best: tuple[int | None, float] = (None, 0.0)
        known = recommended.estimate.model.terms[joint]
        for other in range(n):
            if other == joint or couplings[other, COUPLED[0]] in known or not len(residual):
                continue
            columns = np.concatenate(
                [
                    np.column_stack([b.term(couplings[other, kind])[row, 0] for kind in COUPLED])
                    for b, _, row in pairs
                ]
            )
            solved, *_ = np.linalg.lstsq(columns, residual, rcond=None)
            left = residual - columns @ solved
            share = 1.0 - float(left @ left) / max(float(residual @ residual), 1e-300)
            best = max(best, (other, share), key=lambda pair: pair[1])
        found[joint] = best
    return found


def bound_warnings(estimate: Estimate, fit: ModelFit, cad_mass: Array) -> list[str]:
    """Return warnings about parameters of the recommended estimate at their bounds.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the semidefinite program.
    fit : ModelFit
        Fit with the unconstrained solution in `theta`.
    cad_mass : (n,) ndarray
        Nominal masses [kg].
    """
    warnings = []
    ratio = estimate.inertial[:, 0] / cad_mass
    for bound, word in ((1.0 / MASS_FACTOR, 'half'), (MASS_FACTOR, 'twice')):
        at = np.abs(ratio / bound - 1.0) < _AT_BOUND
        if at.any():
            links = [name for name, held in zip(fit.model.link_names, at, strict=True) if held]
            warnings.append(
                f'mass of {", ".join(links)} is at its bound, {word} the mass in the URDF: check '
                'the masses in the URDF and the unit of the effort'
            )
    start = 10 * fit.model.n
    loads = [term.kind is TermKind.LOAD for _, term in fit.model.joint_columns]
    too_much = np.array(loads, dtype=bool) & (estimate.theta[start:] > 1.0 - _AT_BOUND)
    if too_much.any():
        at_bound = np.array(fit.model.columns[start:])[too_much]
        warnings.append(
            f'{", ".join(at_bound)} at the bound 1, as if the gear lost all transmitted torque: '
            'look for another load-dependent torque at these joints'
        )
    std = fit.prior.std if estimate.std is None else estimate.std
    asked_for_less = estimate.held_at_zero & (fit.theta < -_CLEARLY_NEGATIVE * std)
    held = [
        (name, term.kind)
        for name, (_, term), less in zip(
            fit.model.columns[start:],
            fit.model.joint_columns,
            asked_for_less[start:],
            strict=True,
        )
        if less
    ]
    if held:
        kinds = {kind for _, kind in held}
        if TermKind.COULOMB in kinds:
            check = 'check the sign of the effort of these joints'
        elif kinds == {TermKind.ROTOR}:
            check = (
                'expected if torque sensors sit behind the gears; else the velocities may lag, '
                'or the model of these joints is inexact'
            )
        else:
            check = (
                'the model of these joints is inexact, or their measured velocities lag; check '
                'the errors per joint'
            )
        names = ', '.join(name for name, _ in held)
        warnings.append(f'{names} omitted, because the data ask for a negative value: {check}')
    return warnings


def _suspects(bags: list[SampleColumns], cad: ArmParameters, joints: tuple[str, ...]) -> list[str]:
    """Return texts on joints whose measured and modelled torque differ in sign or magnitude."""
    found = []
    for name, factor in torque_factors(bags, cad, joints).items():
        if factor < 0.0:
            found.append(f'the effort of {name} has the opposite sign')
        elif not 1.0 / _OTHER_UNIT < factor < _OTHER_UNIT:
            found.append(f'the effort of {name} is {factor:.2g} times as large')
    return found
