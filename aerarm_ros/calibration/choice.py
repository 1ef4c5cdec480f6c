"""Choice of the geometric errors whose estimation improves the prediction of new postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from aerarm_ros.calibration.fit import Fit, fitted, free_columns
from aerarm_ros.calibration.geometry import KINDS, LINK_GEOMETRY
from aerarm_ros.calibration.observations import (
    CalibrationError,
    Mask,
    Observations,
    Source,
    norms,
    sigma,
)
from aerarm_ros.motion.signals import Array

_DEPENDENT = 1e-5  # independent fraction of a column, below which the column is dependent
# effect of a typical error on all data in standard deviations, below which it is hidden
_WEAK = 0.3
_POSTURES = 80  # number of random postures that show which errors any posture could identify
_FOLDS = 10
# standard deviations above which an error improves predictions (Akaike 1974)
_SIGNIFICANT = 2.0**0.5
# a joint offset counts as unidentified above this fraction of its prior standard deviation
_UNCERTAIN = 0.8
_STILL = 0.3  # [rad] range over all postures below which a joint hardly moves
_GAIN = 0.5  # standard errors by which a larger model must predict better
_LEAST_GAIN = 0.015  # fraction by which the prediction errors of a larger model must be smaller

LEVELS = {'offsets': ('offset',), 'geometry': ('offset', *LINK_GEOMETRY)}
"""Kinds of geometric errors that a calibration estimates, by the option `level`."""


@dataclass(frozen=True, eq=False)
class Identifiable:
    """Geometric errors, divided into identifiable and non-identifiable ones.

    Attributes
    ----------
    columns : tuple of int
        Indices of errors that the postures identify, separately from each other and from the
        sources' unknowns (base frame and markers).
    absorbed : tuple of int
        Indices of errors that no posture can separate from the errors in `columns`.
    hidden : tuple of int
        Indices of errors that other postures would identify.
    """

    columns: tuple[int, ...]
    absorbed: tuple[int, ...]
    hidden: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Candidate:
    """Set of geometric errors to estimate, with the prediction error on held-out postures.

    Attributes
    ----------
    name : str
        Name of the model, for example 'offsets + compliance'.
    fit : Fit
        Fit to all postures.
    predicted : (M,) ndarray
        Root of the sum of squared residuals of each posture while that posture is held out,
        relative to the noise of the first candidate.
    position, angle : float
        RMS prediction errors of positions [m] (vector norm) and angles [rad] in held-out postures.
    """

    name: str
    fit: Fit
    predicted: Array
    position: float
    angle: float


def identifiable(start: Fit, kinds: Sequence[str]) -> Identifiable:
    """Return which errors of the given kinds the postures identify (rank of the Jacobian).

    The unknowns of the sources have priority: if an arm error has the same effect as an unknown of
    a source, the fit attributes the effect to the source. The errors follow in the order of
    `KINDS`, so an effect is attributed to a joint's offset rather than to a rotation of the
    joint's frame. An error that random postures within the joints' limits would identify, but the
    given postures do not, is hidden.
    """
    wanted = [k for kind in KINDS if kind in kinds for k in start.geometry.columns(kind)]
    found = _independent(start, wanted)
    possible = _independent(_in_random_postures(start), wanted)
    others = [k for k in wanted if k not in found]
    return Identifiable(
        tuple(sorted(found)),
        tuple(k for k in others if k not in possible),
        tuple(k for k in others if k in possible),
    )


def check_unknowns(start: Fit) -> None:
    """Check that the postures identify the unknowns of all sources (base frames, markers).

    Raises
    ------
    CalibrationError
        If postures are too few or too similar; the message names an undetermined unknown.
    """
    rows = free_columns(start, ())
    left = _left_of(rows)
    for name, share in zip(start.names, left, strict=True):
        if share < _DEPENDENT:
            raise CalibrationError(
                f'{name} cannot be estimated, because the {len(start.observations)} postures are '
                'too few or too similar: record at least 15 postures in which every joint moves '
                'by more than 0.5 rad'
            )


def check_offsets(start: Fit, found: Identifiable) -> list[str]:
    """Check that the postures identify the joint offsets; return warnings about uncertain offsets.

    Raises
    ------
    CalibrationError
        If an offset is not identifiable, or half of the offsets keep more than 80 % of their prior
        standard deviation; the message names the offset and the joints to move.
    """
    geometry = start.geometry
    offsets = geometry.columns('offset')
    shown = _independent(start, offsets, weak=0.0)
    for column in _independent(_in_random_postures(start), offsets, weak=0.0):
        if column not in shown:
            raise CalibrationError(_too_similar(start, geometry.names[column]))
    fit = fitted(start, [k for k in found.columns if k in offsets])
    messages = [_too_similar(start, geometry.names[k]) for k in found.hidden if k in offsets]
    for column, deviation in zip(fit.free, fit.deviations, strict=False):
        if deviation > _UNCERTAIN * geometry.typical[column]:
            uncertain = f' (standard deviation {deviation:.2g} {geometry.unit(column)})'
            messages.append(_too_similar(start, geometry.names[column], uncertain))
    if messages and 2 * len(messages) >= len(shown):
        raise CalibrationError(messages[0])
    return messages


def _too_similar(start: Fit, name: str, uncertain: str = '') -> str:
    geometry = start.geometry
    moved = np.ptp(start.observations.q[:, : geometry.n], axis=0)
    still = [
        joint
        for k, joint in enumerate(geometry.joint_names)
        if moved[k] < (_STILL if not geometry.is_prismatic(k) else 0.1 * _STILL)
    ]
    advice = (
        f'move every joint further, above all {", ".join(still)}'
        if still
        else 'record more postures, in which all joints move further'
    )
    return (
        f'{name} cannot be estimated{uncertain}, because the {len(start.observations)} postures '
        f'are too few or too similar: {advice}'
    )


def chosen(start: Fit, level: str, compliance: bool) -> tuple[Candidate, list[Candidate]]:
    """Return the set of geometric errors that predicts best, and all sets that were tried.

    In each model, errors within 1.4 standard deviations of nominal are set to nominal, as long as
    the prediction of held-out postures does not worsen. A larger model is chosen only if the mean
    prediction error of the postures falls by more than half the standard error of this difference,
    and by more than 1.5 %.

    Parameters
    ----------
    start : Fit
        Registration of the nominal geometry.
    level : {'offsets', 'geometry', 'auto'}
        Largest set of errors, or automatic choice.
    compliance : bool
        Whether to try models with joint compliance.
    """
    names = {'auto': ('offsets', 'geometry')}.get(level, (level,))
    scale = fitted(start, identifiable(start, LEVELS[names[0]]).columns)
    noise = scale.length, scale.angle
    tried = [_candidate('frames', start, (), noise)]
    measured = sum(int(np.isfinite(residual).sum()) for residual in start.residuals())
    best: Candidate | None = None
    extras = [('', ()), (' + compliance', ('compliance',))] if compliance else [('', ())]
    for errors, (label, kinds) in product(names, extras):
        name = f'{errors}{label}'
        columns = identifiable(start, (*LEVELS[errors], *kinds)).columns
        if not columns or len(columns) >= measured // 2:
            continue
        other = whole = _candidate(name, start, columns, noise)
        tried.append(whole)
        if removed := insignificant(whole.fit):
            kept = [k for k in whole.fit.free if k not in removed]
            smaller = _candidate(f'{name}, significant ones', start, kept, noise)
            tried.append(smaller)
            other = whole if _predicts_better(whole, smaller) else smaller
        if best is None or _predicts_better(other, best):
            best = other
    return best or tried[0], tried


def insignificant(fit: Fit) -> list[int]:
    """Return the estimated errors within 1.4 standard deviations of zero, the smallest first.

    After each removal the remaining errors are updated as in a fit without the removed error.
    """
    count = len(fit.free)
    values = fit.errors[list(fit.free)].copy()
    covariance = fit.covariance[:count, :count].copy()
    softens = [fit.geometry.names[k].endswith('.compliance') for k in fit.free]
    left = list(range(count))
    removed = []
    while left:
        deviation = np.sqrt(np.maximum(np.diag(covariance)[left], 1e-300))
        ratio = np.abs(values[left]) / deviation
        weakest = left[int(np.argmin(ratio))]
        implausible = [k for k in left if softens[k] and values[k] < 0.0]
        if not implausible and ratio.min() >= _SIGNIFICANT:
            break
        weakest = implausible[0] if implausible else weakest
        gain = covariance[:, weakest] / covariance[weakest, weakest]
        values = values - gain * values[weakest]
        covariance = covariance - np.outer(gain, covariance[weakest])
        left.remove(weakest)
        removed.append(fit.free[weakest])
    return removed


def cross_validated(start: Fit, columns: Sequence[int]) -> list[Array]:
    """Return residuals (M, K) of each source; the fit for a posture omits the posture itself."""
    observations, count = start.observations, len(start.observations)
    order = np.random.default_rng(0).permutation(count)
    found = [np.full_like(residual, np.nan) for residual in start.residuals()]
    for fold in range(min(_FOLDS, count)):
        out = np.sort(order[fold::_FOLDS])
        kept = np.setdiff1d(np.arange(count), out)
        fit = fitted(start, columns, observations.rows(kept))
        for whole, part in zip(found, fit.residuals(observations.rows(out)), strict=True):
            whole[out] = part
    return found


def errors_of(sources: Sequence[Source], residuals: Sequence[Array]) -> tuple[float, float]:
    """Return the RMS norms of position residuals [m] and of angle residuals [rad]."""
    position, angle = (list(norms(sources, residuals, unit).values()) for unit in ('m', 'rad'))
    return _rms(position), _rms(angle)


def _rms(norms: Sequence[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate(norms) ** 2))) if norms else float('nan')


def _candidate(
    name: str, start: Fit, columns: Sequence[int], noise: tuple[float, float]
) -> Candidate:
    fit = fitted(start, columns)
    residuals = cross_validated(fit, columns)
    sources = start.observations.sources
    predicted = np.zeros(len(start.observations))
    for source, residual in zip(sources, residuals, strict=True):
        predicted += np.nansum((residual / sigma(source, *noise)) ** 2, axis=1)
    position, angle = errors_of(sources, residuals)
    # Roots instead of squares: a single unexplained posture must not determine the choice.
    return Candidate(name, fit, np.sqrt(predicted), position, angle)


def _predicts_better(one: Candidate, other: Candidate) -> bool:
    gain = other.predicted - one.predicted
    error = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    least = max(_GAIN * error, _LEAST_GAIN * float(np.mean(other.predicted)))
    return bool(float(np.mean(gain)) > least)


def _independent(start: Fit, wanted: Sequence[int], weak: float = _WEAK) -> list[int]:
    """Return the errors whose effect no combination of unknowns and earlier errors reproduces."""
    rows = free_columns(start, wanted)
    count = len(wanted)
    basis = _orthonormal(rows[:, count:])
    found = []
    for place, column in enumerate(wanted):
        size, left, rest = _beyond(basis, rows[:, place])
        if left > max(_DEPENDENT * size, weak):
            found.append(column)
            basis = np.column_stack([basis, rest / left])
    return found


def _left_of(rows: Array) -> Array:
    """Return the fraction of each column that is linearly independent of earlier columns."""
    basis = np.zeros((len(rows), 0))
    shares = []
    for own in rows.T:
        size, left, rest = _beyond(basis, own)
        shares.append(left / size if size > 0.0 else 0.0)
        if left > _DEPENDENT * max(size, 1e-300):
            basis = np.column_stack([basis, rest / left])
    return np.array(shares)


def _beyond(basis: Array, own: Array) -> tuple[float, float, Array]:
    """Return the lengths of a column and of its part orthogonal to the basis, and this part."""
    rest = own - basis @ (basis.T @ own)
    rest -= basis @ (basis.T @ rest)
    return float(np.linalg.norm(own)), float(np.linalg.norm(rest)), rest


def _orthonormal(rows: Array) -> Array:
    left, size, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(left[:, size > _DEPENDENT * max(size.max(initial=0.0), 1e-300)])


def _in_random_postures(start: Fit) -> Fit:
    low, high = start.geometry.robot.posture_range
    generator = np.random.default_rng(0)
    q = generator.uniform(low, high, (_POSTURES, start.geometry.robot.n))
    # Assume complete, error-free measurements, because only the derivatives matter.
    index = np.resize(np.flatnonzero(_all_seen(start.observations)), _POSTURES)
    sources = start.observations.rows(index).sources
    observations = Observations(q, sources)
    return Fit(start.geometry, observations, (), start.errors, start.states)


def _all_seen(observations: Observations) -> Mask:
    seen = [source.seen for source in observations.sources]
    everywhere: Mask = np.all(seen, axis=0)
    return everywhere if everywhere.any() else np.asarray(np.any(seen, axis=0))
