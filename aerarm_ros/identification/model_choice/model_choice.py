"""Choosing the terms of each joint and fitting the model that results."""

from collections.abc import Sequence

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.model_choice.cross_validation import CrossValidation
from aerarm_ros.identification.model_choice.joint_model_selection import (
    ASYMMETRY_WIDTH,
    CREEP_WIDTHS,
    STRIBECK_WIDTHS,
    Comparison,
    candidate_terms,
    select_terms,
)
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.coupled_joints import CoupledJoints, coupled_terms
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import ROTOR, THESIS_TERMS, JointTerm, TermKind
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.regression.model_fit import ModelFit, fit_model
from aerarm_ros.identification.regression.prior import LINK_SPREAD
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.sample_columns import SampleColumns

AUTOMATIC = 'auto'

FRICTION_MODELS: dict[str, tuple[JointTerm, ...]] = {
    'coulomb': (*THESIS_TERMS, ROTOR),
    'load': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.LOAD)),
    'offset': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.OFFSET)),
    'creep': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.CREEP, CREEP_WIDTHS[0])),
    'stribeck': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.STRIBECK, STRIBECK_WIDTHS[0])),
    'asymmetric': (
        *THESIS_TERMS,
        ROTOR,
        JointTerm(TermKind.FORWARD, ASYMMETRY_WIDTH),
        JointTerm(TermKind.BACKWARD, ASYMMETRY_WIDTH),
    ),
}
"""Friction models with a name, each (2.6) and rotors plus what its name says.

Names joined by '+' are combined; 'auto' chooses each joint's terms by cross-validation.
"""

# What the links weigh decides the load that friction depends on, and the other way round.
_ROUNDS = 2


def friction_terms(friction: str) -> tuple[JointTerm, ...]:
    """Return the terms of one model, or of several joined by '+'.

    Raises
    ------
    IdentificationError
        If there is no such model.
    """
    names = friction.split('+')
    unknown = [name for name in names if name not in FRICTION_MODELS]
    if unknown:
        raise IdentificationError(
            f'--friction {friction}: no model {", ".join(map(repr, unknown))}: give {AUTOMATIC}, '
            f'or one or several of {", ".join(FRICTION_MODELS)} joined by +'
        )
    return tuple(dict.fromkeys(term for name in names for term in FRICTION_MODELS[name]))


def choose_model(
    robot: Robot,
    bags: Sequence[SampleColumns],
    cad: ArmParameters,
    friction: str,
    coupled: CoupledJoints = (),
) -> tuple[ModelFit, list[Comparison]]:
    """Fit the joints' terms that were asked for, or those that predict unseen motion best.

    Parameters
    ----------
    robot : Robot
    bags : sequence of SampleColumns
        To identify from; the choice is made by cross-validation within them.
    cad : ArmParameters
    friction : str
        'auto', a key of `FRICTION_MODELS`, or several joined by '+'.
    coupled : sequence of (joint, driver)
        Joints that get the columns of `coupled_terms` in any case.

    Returns
    -------
    ModelFit
    list of Comparison
        What was tried in the last round; empty if nothing was chosen.

    Raises
    ------
    IdentificationError
        If there is no such friction model, or no such joint.
    """
    couplings = coupled_terms(robot.joint_names, coupled)
    chosen = () if friction == AUTOMATIC else friction_terms(friction)
    simple = FRICTION_MODELS['coulomb']
    terms: Sequence[Sequence[JointTerm]] = [(*simple, *own) for own in couplings]
    fit = fit_model(bags, RegressionBank(bags, _all(terms)), _model(robot, terms), cad)
    comparisons: list[Comparison] = []
    if friction == AUTOMATIC:
        for _ in range(_ROUNDS):
            bank = RegressionBank(bags, (*candidate_terms(), *_all(couplings)), fit.inertial)
            mean, std = cad.inertial.ravel(), LINK_SPREAD * cad.inertial_scale().ravel()
            validation = CrossValidation(bank, mean, std, fit.noise.weights)
            terms, comparisons = select_terms(validation, terms)
            fit = fit_model(bags, bank, _model(robot, terms), cad, fit.noise)
    elif chosen != simple:
        terms = [(*chosen, *own) for own in couplings]
        bank = RegressionBank(bags, _all(terms), fit.inertial)
        fit = fit_model(bags, bank, _model(robot, terms), cad, fit.noise)
    if fit.model.depends_on_load:
        own = [term for _, term in fit.model.joint_columns]
        fit = fit_model(bags, RegressionBank(bags, own, fit.inertial), fit.model, cad, fit.noise)
    return fit, comparisons


def _all(terms: Sequence[Sequence[JointTerm]]) -> list[JointTerm]:
    return list(dict.fromkeys(term for own in terms for term in own))


def _model(robot: Robot, terms: Sequence[Sequence[JointTerm]]) -> JointModel:
    return JointModel(robot.joint_names, robot.link_names, tuple(tuple(own) for own in terms))
