"""Choosing each joint's friction model by cross-validation within the identification bags."""

from collections.abc import Sequence
from dataclasses import dataclass

from aerarm_ros.identification.model_choice.cross_validation import CrossValidation
from aerarm_ros.identification.parameters.joint_term import ROTOR, JointTerm, TermKind

WIDTHS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Velocities [rad/s] over which dry friction may change sign; 0 is the step of (2.6)."""

CREEP_WIDTHS = (0.3, 0.6)
"""Velocities [rad/s] at which slowly rising friction levels off."""

STRIBECK_WIDTHS = (0.05, 0.15)
"""Velocities [rad/s] above which the friction of standstill has gone."""

ASYMMETRY_WIDTH = 0.02
"""Velocity [rad/s] over which friction that acts in one direction sets in."""

# A term stays if it lowers the held-out error of its arm by this share: smaller gains are
# within what another recording of the same motion would change.
_WORTHWHILE = 5e-3

_VISCOUS = JointTerm(TermKind.VISCOUS)
_OFFSET = JointTerm(TermKind.OFFSET)
_DRY = (TermKind.COULOMB, TermKind.LOAD)
_SWITCHED = (
    _OFFSET,
    *(JointTerm(TermKind.CREEP, width) for width in CREEP_WIDTHS),
    *(JointTerm(TermKind.STRIBECK, width) for width in STRIBECK_WIDTHS),
    *(JointTerm(kind, ASYMMETRY_WIDTH) for kind in (TermKind.FORWARD, TermKind.BACKWARD)),
)
# What takes each other's place: a joint has one of them at most.
_RIVALS = ({TermKind.FORWARD, TermKind.BACKWARD, TermKind.OFFSET},)


@dataclass(frozen=True)
class Comparison:
    """One model that was tried for a joint.

    Attributes
    ----------
    joint : int
    terms : tuple of JointTerm
    error : float
        Held-out squared torque error of the arm relative to the model it started from.
    chosen : bool
    """

    joint: int
    terms: tuple[JointTerm, ...]
    error: float
    chosen: bool


def candidate_terms() -> tuple[JointTerm, ...]:
    """Return every term that a joint may get."""
    dry = [JointTerm(kind, width) for kind in _DRY for width in WIDTHS]
    return (_VISCOUS, ROTOR, *dry, *_SWITCHED)


def select_terms(
    validation: CrossValidation, start: Sequence[Sequence[JointTerm]]
) -> tuple[tuple[tuple[JointTerm, ...], ...], list[Comparison]]:
    """Choose the terms of every joint.

    For one joint after the other: first how sharply its dry friction changes sign and
    whether it grows with the load, then whether creep, Stribeck friction, asymmetry or an
    offset predict unseen motion better, then the first question again.

    Parameters
    ----------
    validation : CrossValidation
    start : n sequences of JointTerm
        Where to begin, such as viscous, Coulomb and rotor for every joint.

    Returns
    -------
    tuple of n tuples of JointTerm
    list of Comparison
        What was compared.
    """
    terms = [tuple(own) for own in start]
    best = validation.score(terms)
    first = best
    comparisons: list[Comparison] = []
    for joint in range(len(terms)):
        for stage in (_dry_variants, _switches, _switches, _dry_variants):
            variants = stage(terms[joint])
            errors = validation.score_variants(terms, joint, variants)
            index = int(errors.argmin())
            better = errors[index] < best * (1.0 - _WORTHWHILE)
            comparisons += [
                Comparison(joint, variant, float(error) / first, better and i == index)
                for i, (variant, error) in enumerate(zip(variants, errors, strict=True))
            ]
            if better:
                terms[joint], best = variants[index], float(errors[index])
    return tuple(terms), comparisons


def _dry_variants(terms: tuple[JointTerm, ...]) -> list[tuple[JointTerm, ...]]:
    """Return the terms with dry friction of every width, with and without load dependence.

    Width and load dependence are scanned together: each alone may predict no better.
    """
    others = tuple(term for term in terms if term.kind not in _DRY)
    variants = []
    for width in WIDTHS:
        coulomb, load = (JointTerm(kind, width) for kind in _DRY)
        variants += [(*others, coulomb), (*others, coulomb, load)]
    return variants


def _switches(terms: tuple[JointTerm, ...]) -> list[tuple[JointTerm, ...]]:
    """Return the terms with each of the other optional ones added, exchanged or left out."""
    variants = []
    for term in _SWITCHED:
        replaced = next((group for group in _RIVALS if term.kind in group), {term.kind})
        others = tuple(t for t in terms if t.kind not in replaced)
        variants.append(others if term in terms else (*others, term))
    return variants
