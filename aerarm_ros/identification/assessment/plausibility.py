"""What a result says about its input: signs, units, gravity, bounds."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.identification_result import Solution
from aerarm_ros.identification.parameters.joint_term import TermKind
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.physical_limits import MASS_FACTOR

Array = npt.NDArray[np.float64]

# [%] of torque error: predicting no torque at all leaves 100, which efforts in a much smaller
# unit approach from below.
_USELESS = 90.0
# The semidefinite program costs a few per cent of the least error, not several times it.
_FAR_ABOVE = 3.0
_LARGE = 10.0  # [%]
_OPPOSITE = -0.5  # correlation of measured and drawn torque
_OTHER_UNIT = 5.0  # factor between their sizes
_AT_BOUND = 0.01  # share of a mass
_CLEARLY_NEGATIVE = 3.0  # standard deviations
_NEGLIGIBLE = 1e-3  # standard deviations

_CHECK = (
    'check the sign and unit of the effort (--effort-gain JOINT=Nm/A for amperes, =-1 for the '
    'other sign), the direction of gravity (--gravity), the topic, and that the names of the '
    "bag's joints belong to the joints that move (--rename)"
)


def error_warnings(
    solutions: Mapping[str, Solution], bags: list[SampleColumns], joints: tuple[str, ...]
) -> list[str]:
    """Return what torque errors reveal of a wrong input.

    Parameters
    ----------
    solutions : mapping
        By solver; 'cad', 'ols' and 'sdp' are there.
    bags : list of SampleColumns
        The identification bags.
    joints : tuple of str
    """
    cad, ols, sdp = (
        float(np.mean([bag.filtered for bag in solutions[name].identification]))
        for name in ('cad', 'ols', 'sdp')
    )
    warnings = []
    if cad > _USELESS:
        suspects = _suspects(solutions['cad'], bags, joints)
        hint = f' ({"; ".join(suspects)})' if suspects else ''
        warnings.append(f'the CAD model misses the measured torque by {cad:.0f} %{hint}: {_CHECK}')
    if sdp > max(_LARGE, _FAR_ABOVE * ols):
        warnings.append(
            f'a physically consistent arm leaves {sdp:.1f} % of the torque unexplained, least '
            f'squares without that condition {ols:.1f} %: no real arm of this URDF moves like '
            f'this; {_CHECK}'
        )
    return warnings


def bound_warnings(estimate: Estimate, fit: ModelFit, cad_mass: Array) -> list[str]:
    """Return which parameters of the recommended estimate are held by their bounds.

    Parameters
    ----------
    estimate : Estimate
        By the semidefinite program.
    fit : ModelFit
        Its `theta` is the solution without constraints.
    cad_mass : (n,) ndarray
        [kg]
    """
    warnings = []
    ratio = estimate.inertial[:, 0] / cad_mass
    for bound, word in ((1.0 / MASS_FACTOR, 'half'), (MASS_FACTOR, 'twice')):
        at = np.abs(ratio / bound - 1.0) < _AT_BOUND
        if at.any():
            links = [name for name, held in zip(fit.model.link_names, at, strict=True) if held]
            warnings.append(
                f'mass of {", ".join(links)} is at its bound, {word} that of the URDF: check the '
                'masses in the URDF and the unit of the effort'
            )
    start = 10 * fit.model.n
    std = fit.prior.std if estimate.std is None else estimate.std
    asked_for_less = held_at_zero(estimate) & (fit.theta < -_CLEARLY_NEGATIVE * std)
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
        dry = any(kind is TermKind.COULOMB for _, kind in held)
        warnings.append(
            f'{", ".join(name for name, _ in held)} held at the bound 0, the data ask for less: '
            + (
                'check the sign of the effort of these joints'
                if dry
                else 'the model of these joints is not exact, or their measured velocities lag '
                'behind; check the errors joint by joint'
            )
        )
    return warnings


def held_at_zero(estimate: Estimate) -> npt.NDArray[np.bool_]:
    """Return (p,) which parameters of an estimate with standard deviations lie at their bound 0."""
    signed = np.array([term.nonnegative for _, term in estimate.model.joint_columns], dtype=bool)
    held = np.zeros(len(estimate.theta), dtype=bool)
    if estimate.std is not None:
        start = 10 * estimate.model.n
        held[start:] = signed & (estimate.theta[start:] < _NEGLIGIBLE * estimate.std[start:])
    return held


def _suspects(cad: Solution, bags: list[SampleColumns], joints: tuple[str, ...]) -> list[str]:
    """Return joints whose torque runs against the drawing's or has another size."""
    measured, drawn = (
        np.vstack([values[bag.samples.kept] for values, bag in zip(group, bags, strict=True)])
        for group in (
            [bag.samples.tau for bag in bags],
            [bag.prediction.filtered for bag in cad.identification],
        )
    )
    found = []
    for joint, name in enumerate(joints):
        size, expected = (float(np.linalg.norm(x[:, joint])) for x in (measured, drawn))
        if min(size, expected) <= 0.0:
            continue
        along = float(measured[:, joint] @ drawn[:, joint]) / (size * expected)
        if along < _OPPOSITE:
            found.append(f"{name}'s effort has the opposite sign")
        elif size > _OTHER_UNIT * expected or expected > _OTHER_UNIT * size:
            found.append(f"{name}'s effort is {size / expected:.2g} times as large")
    return found
