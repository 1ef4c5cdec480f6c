"""Choice of each joint's friction and other terms, and fit of the resulting torque model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    ArmParameters,
    CoupledJoints,
    JointModel,
    JointTerm,
    TermKind,
    coupled_terms,
)
from aerarm_ros.identification.model_fit import LINK_SPREAD, ModelFit, RegressionBank, fit_model
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.motion.signals import Array

Mask = npt.NDArray[np.bool_]

# Parameter combinations of the links whose eigenvalue of the Gram matrix is below this fraction
# of the largest have no effect on any torque.
_NO_EFFECT = 1e-12


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """Fitted joint coefficients as linear functions `constant - slope x` of link parameters x.

    `hessian` and `gradient` are the information that remains in the joint's rows about x. The
    leading axes of all arrays are variants of the joint's terms, and held-out parts of the
    motion.
    """

    hessian: Array
    gradient: Array
    constant: Array
    slope: Array


class CrossValidation:
    """Prediction of each part of the identification motion, by a fit to all other parts.

    The links' parameters are common to all joints, while a joint's terms affect only its own
    torque. So each joint's terms are eliminated first (a Schur complement), and a change of one
    joint's terms needs only a new solution for the links.

    Parameters
    ----------
    link_mean, link_std : (10 n,) ndarray
        Mean and standard deviation of the prior of the inertial parameters.
    weights : (n,) ndarray
        Weights of the joints' rows: one over the noise of each joint [1/Nm].
    """

    def __init__(
        self, bank: RegressionBank, link_mean: Array, link_std: Array, weights: Array
    ) -> None:
        self._place = {term: place for place, term in enumerate(bank.terms)}
        self._nonnegative = np.array([term.nonnegative for term in bank.terms])
        count = len(link_mean)
        rows = [
            [
                _in_prior_units(factor, link_mean, link_std, weights[joint])
                for factor in bank.factors[joint]
            ]
            for joint in range(bank.n)
        ]
        grams = np.array([[row.T @ row for row in own] for own in rows])
        # Only parameter combinations y with an effect on the torque are kept; x = V y preserves
        # prior and torques.
        values, vectors = np.linalg.eigh(grams[..., :count, :count].sum(axis=(0, 1)))
        effective = vectors[:, values > _NO_EFFECT * values[-1]]
        self._links = effective.shape[1]
        transform = np.zeros((grams.shape[-1], self._links + grams.shape[-1] - count))
        transform[:count, : self._links] = effective
        transform[count:, self._links :] = np.eye(grams.shape[-1] - count)
        self._held_out = transform.T @ grams @ transform
        self._training = self._held_out.sum(axis=1, keepdims=True) - self._held_out

    def score(self, terms: Sequence[Sequence[JointTerm]]) -> float:
        """Return the held-out squared torque error of a model, relative to the squared noise.

        Parameters
        ----------
        terms : n sequences of JointTerm
            Terms of each joint.
        """
        return float(self.score_variants(terms, 0, [terms[0]])[0])

    def score_variants(
        self,
        terms: Sequence[Sequence[JointTerm]],
        joint: int,
        variants: Sequence[Sequence[JointTerm]],
    ) -> Array:
        """Return the held-out squared errors for variants of one joint's terms.

        Parameters
        ----------
        terms : n sequences of JointTerm
            Terms of each joint; those of `joint` are ignored.
        joint : int
            Index of the joint to vary.
        variants : V sequences of JointTerm
            Alternative terms of that joint.

        Returns
        -------
        (V,) ndarray
            Errors relative to the squared noise, summed over joints and parts.
        """
        links = self._links
        masks = np.array([self._mask(variant) for variant in variants])
        own = self._eliminate(joint, masks)
        hessian, gradient = np.eye(links) + own.hessian, own.gradient.copy()
        others: list[tuple[int, _Eliminated]] = []
        for other, its_terms in enumerate(terms):
            if other != joint:
                part = self._eliminate(other, self._mask(its_terms)[None])
                hessian += part.hessian
                gradient += part.gradient
                others.append((other, part))
        x: Array = np.asarray(np.linalg.solve(hessian, gradient[..., None])[..., 0])
        errors = self._error(joint, x, own)
        for other, part in others:
            errors += self._error(other, x, part)
        return np.asarray(errors.sum(axis=1))

    def _mask(self, terms: Sequence[JointTerm]) -> Mask:
        mask = np.zeros(len(self._place), dtype=bool)
        mask[[self._place[term] for term in terms]] = True
        return mask

    def _eliminate(self, joint: int, masks: Mask) -> _Eliminated:
        links = self._links
        gram = self._training[joint]
        selected = masks[:, None, :]
        diagonal = np.diagonal(gram, axis1=1, axis2=2)[:, links:-1]
        # A prior standard deviation of a coefficient would explain all of the joint's torque.
        ridge = diagonal / np.maximum(gram[:, -1:, -1], 1e-300) + 1e-9 * diagonal + 1e-300
        square = gram[:, links:-1, links:-1] * (selected[..., None] & selected[..., None, :])
        index = np.arange(square.shape[-1])
        square[..., index, index] += np.where(selected, ridge, 1.0)
        cross = gram[:, links:-1, :links] * selected[..., None]
        right = gram[:, links:-1, -1:] * selected[..., None]
        solved = np.linalg.solve(square, np.concatenate([right, cross], axis=-1))
        constant, slope = solved[..., 0], solved[..., 1:]
        turned = np.swapaxes(cross, -1, -2)
        return _Eliminated(
            hessian=gram[:, :links, :links] - turned @ slope,
            gradient=gram[:, :links, -1] - (turned @ constant[..., None])[..., 0],
            constant=constant,
            slope=slope,
        )

    def _error(self, joint: int, x: Array, part: _Eliminated) -> Array:
        own = part.constant - (part.slope @ x[..., None])[..., 0]
        # A term that improves the fit only with a negative coefficient is not friction.
        own = np.where(self._nonnegative, np.maximum(own, 0.0), own)
        solution = np.concatenate([x, own, -np.ones((*x.shape[:-1], 1))], axis=-1)
        return np.asarray(
            ((solution[..., None, :] @ self._held_out[joint])[..., 0, :] * solution).sum(-1)
        )


def _in_prior_units(factor: Array, mean: Array, std: Array, weight: float) -> Array:
    """Return weighted rows in new unknowns: deviations from the prior in standard deviations."""
    rows = weight * factor
    links = len(mean)
    rows[:, -1] -= rows[:, :links] @ mean
    rows[:, :links] *= std
    return np.asarray(rows)


WIDTHS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Candidate velocities [rad/s] over which dry friction changes sign; 0 is a step (thesis 2.6)."""

DISTANCES = (0.003, 0.01, 0.03)
"""Candidate angles [rad] over which dry friction builds up after a reversal."""

CREEP_WIDTHS = (0.3, 0.6)
"""Candidate velocities [rad/s] at which saturating viscous friction levels off."""

STRIBECK_WIDTHS = (0.05, 0.15)
"""Candidate velocities [rad/s] above which Stribeck friction vanishes."""

ASYMMETRY_WIDTH = 0.02
"""Velocity [rad/s] over which asymmetric friction develops."""

# A term is kept if it lowers the held-out squared error of the arm by this fraction. Smaller
# changes also occur between two recordings of the same motion.
_LEAST_GAIN = 5e-3

_VISCOUS = JointTerm(TermKind.VISCOUS)
_OFFSET = JointTerm(TermKind.OFFSET)
_DRY = (TermKind.COULOMB, TermKind.LOAD)
# Pairs of width and distance; at most one of both is not zero.
_REVERSALS = (*((width, 0.0) for width in WIDTHS), *((0.0, angle) for angle in DISTANCES))
_SWITCHED = (
    _OFFSET,
    *(JointTerm(TermKind.CREEP, width) for width in CREEP_WIDTHS),
    *(JointTerm(TermKind.STRIBECK, width) for width in STRIBECK_WIDTHS),
    *(JointTerm(kind, ASYMMETRY_WIDTH) for kind in (TermKind.FORWARD, TermKind.BACKWARD)),
)
# Mutually exclusive terms: a joint has at most one of them.
_EXCLUSIVE = ({TermKind.FORWARD, TermKind.BACKWARD, TermKind.OFFSET},)


def candidate_terms() -> tuple[JointTerm, ...]:
    """Return all friction, rotor and offset terms that the choice considers for a joint."""
    dry = [JointTerm(kind, w, distance=d) for kind in _DRY for w, d in _REVERSALS]
    return (_VISCOUS, ROTOR, *dry, *_SWITCHED)


def select_terms(
    validation: CrossValidation, start: Sequence[Sequence[JointTerm]]
) -> tuple[tuple[JointTerm, ...], ...]:
    """Return the friction terms of every joint, chosen by cross-validation.

    Each joint goes through three steps before the next joint. First the reversal of dry
    friction (velocity width or build-up distance) and its dependence on load are chosen. Then
    saturating viscous friction, Stribeck friction, asymmetry and offset are tested on held-out
    motion. Finally the first step is repeated.

    Parameters
    ----------
    start : n sequences of JointTerm
        Initial terms, for example viscous, Coulomb and rotor for every joint.
    """
    terms = [tuple(own) for own in start]
    best = validation.score(terms)
    for joint in range(len(terms)):
        for stage in (_dry_variants, _switches, _switches, _dry_variants):
            variants = stage(terms[joint])
            errors = validation.score_variants(terms, joint, variants)
            index = int(errors.argmin())
            if errors[index] < best * (1.0 - _LEAST_GAIN):
                terms[joint], best = variants[index], float(errors[index])
    return tuple(terms)


def _dry_variants(terms: tuple[JointTerm, ...]) -> list[tuple[JointTerm, ...]]:
    """Return variants of the terms: each model of dry friction at reversal, with and without load.

    Reversal and load dependence are varied together, because a change of only one may not improve
    the prediction.
    """
    others = tuple(term for term in terms if term.kind not in _DRY)
    variants = []
    for width, distance in _REVERSALS:
        coulomb, load = (JointTerm(kind, width, distance=distance) for kind in _DRY)
        variants += [(*others, coulomb), (*others, coulomb, load)]
    return variants


def _switches(terms: tuple[JointTerm, ...]) -> list[tuple[JointTerm, ...]]:
    """Return variants of the terms with one optional term added, exchanged or removed."""
    variants = []
    for term in _SWITCHED:
        replaced = next((group for group in _EXCLUSIVE if term.kind in group), {term.kind})
        others = tuple(t for t in terms if t.kind not in replaced)
        variants.append(others if term in terms else (*others, term))
    return variants


AUTOMATIC = 'auto'
DAHL = 'dahl'

FRICTION_MODELS: dict[str, tuple[JointTerm, ...]] = {
    'coulomb': (*THESIS_TERMS, ROTOR),
    'load': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.LOAD)),
    'offset': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.OFFSET)),
    'creep': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.CREEP, CREEP_WIDTHS[0])),
    'stribeck': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.STRIBECK, STRIBECK_WIDTHS[0])),
    DAHL: (_VISCOUS, JointTerm(TermKind.COULOMB, distance=DISTANCES[1]), ROTOR),
    'asymmetric': (
        *THESIS_TERMS,
        ROTOR,
        JointTerm(TermKind.FORWARD, ASYMMETRY_WIDTH),
        JointTerm(TermKind.BACKWARD, ASYMMETRY_WIDTH),
    ),
}
"""Friction models by name.

Each model contains viscous and Coulomb friction, rotor inertia and the term in its name. With
'dahl', Coulomb and load-dependent friction build up over an angle after a reversal. Models whose
names are joined by '+' are combined; 'auto' chooses each joint's terms by cross-validation.
"""

# repeated, because the links' parameters determine the load on which friction depends, and vice
# versa
_ROUNDS = 2


def friction_terms(friction: str) -> tuple[JointTerm, ...]:
    """Return the joint terms of one friction model, or of several models joined by '+'.

    Raises
    ------
    IdentificationError
        If the model is unknown.
    """
    names = friction.split('+')
    unknown = [name for name in names if name not in FRICTION_MODELS]
    if unknown:
        raise IdentificationError(
            f'friction model {", ".join(map(repr, unknown))} of --friction {friction} is '
            f'unknown: pass {AUTOMATIC}, or one or several of {", ".join(FRICTION_MODELS)} '
            'joined by +'
        )
    terms = [term for name in names for term in FRICTION_MODELS[name]]
    if DAHL in names:
        terms = [
            replace(term, distance=DISTANCES[1]) if term.kind in _DRY else term for term in terms
        ]
    return tuple(dict.fromkeys(terms))


def choose_model(
    robot: Robot,
    bags: Sequence[SampleColumns],
    cad: ArmParameters,
    friction: str,
    coupled: CoupledJoints = (),
) -> ModelFit:
    """Fit the requested joint terms; for 'auto', the terms that predict held-out motion best.

    Parameters
    ----------
    bags : sequence of SampleColumns
        Identification bags; cross-validation within them determines the choice.
    friction : str
        'auto', a key of `FRICTION_MODELS`, or several joined by '+'.
    coupled : sequence of (joint, driver)
        Joints that always get the columns of `coupled_terms`.

    Raises
    ------
    IdentificationError
        If the friction model or a joint is unknown.
    """
    couplings = coupled_terms(robot.joint_names, coupled)
    chosen = () if friction == AUTOMATIC else friction_terms(friction)
    simple = FRICTION_MODELS['coulomb']
    terms: Sequence[Sequence[JointTerm]] = [(*simple, *own) for own in couplings]
    fit = fit_model(bags, RegressionBank(bags, _all(terms)), _model(robot, terms), cad)
    if friction == AUTOMATIC:
        for _ in range(_ROUNDS):
            bank = RegressionBank(bags, (*candidate_terms(), *_all(couplings)), fit.inertial)
            mean, std = cad.inertial.ravel(), LINK_SPREAD * cad.inertial_scale().ravel()
            validation = CrossValidation(bank, mean, std, fit.noise.weights)
            terms = select_terms(validation, terms)
            fit = fit_model(bags, bank, _model(robot, terms), cad, fit.noise)
    elif chosen != simple:
        terms = [(*chosen, *own) for own in couplings]
        bank = RegressionBank(bags, _all(terms), fit.inertial)
        fit = fit_model(bags, bank, _model(robot, terms), cad, fit.noise)
    if fit.model.depends_on_load:
        own = [term for _, term in fit.model.joint_columns]
        fit = fit_model(bags, RegressionBank(bags, own, fit.inertial), fit.model, cad, fit.noise)
    for bag in bags:
        bag.free_memory()
    return fit


def _all(terms: Sequence[Sequence[JointTerm]]) -> list[JointTerm]:
    return list(dict.fromkeys(term for own in terms for term in own))


def _model(robot: Robot, terms: Sequence[Sequence[JointTerm]]) -> JointModel:
    return JointModel(robot.joint_names, robot.link_names, tuple(tuple(own) for own in terms))
