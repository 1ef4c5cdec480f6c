"""Calibration of an arm's geometry from measurements in postures at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from aerarm_ros.calibration.chain import Chain
from aerarm_ros.calibration.checks import (
    check_count,
    check_misfit,
    check_positions,
    check_rigid,
    check_units,
    without_copies,
)
from aerarm_ros.calibration.choice import (
    LEVELS,
    Candidate,
    Identifiable,
    check_offsets,
    check_unknowns,
    chosen,
    errors_of,
    identifiable,
)
from aerarm_ros.calibration.fit import Fit, fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry, Tolerance
from aerarm_ros.calibration.observations import CalibrationError, MarkerSource, Observations, norms


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibrated geometry of an arm.

    Attributes
    ----------
    registration : Fit
        Fit of base frame and marker positions only, with the nominal geometry.
    best : Candidate
        Chosen set of geometric errors, with its fit.
    tried : tuple of Candidate
        All sets of geometric errors that were tried.
    found : Identifiable
        Geometric errors that the postures identify, and those that they do not.
    held_out : dict of str to Observations
        Postures for validation by name: the fit omits them, and they test the geometry.
    messages : list of str
        Notes for the user.
    """

    chain: Chain
    registration: Fit
    best: Candidate
    tried: tuple[Candidate, ...]
    found: Identifiable
    held_out: Mapping[str, Observations] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)

    @property
    def fit(self) -> Fit:
        """Fit of the chosen set of geometric errors."""
        return self.best.fit

    @property
    def observations(self) -> Observations:
        """Observations used for the fit."""
        return self.fit.observations

    @property
    def groups(self) -> dict[str, Observations]:
        """Fitted postures, with the name 'training', and held-out postures by name."""
        return {'training': self.observations, **self.held_out}

    @property
    def as_drawn(self) -> dict[str, list[str]]:
        """Names of the errors that are not estimated, grouped by the reason for the omission."""
        names, found = self.fit.geometry.names, self.found
        return {
            'insignificant': [names[k] for k in found.columns if k not in self.fit.free],
            'not_shown_by_these_postures': [names[k] for k in found.hidden],
            'absorbed': [names[k] for k in found.absorbed],
        }

    def errors(self, fit: Fit, observations: Observations | None = None) -> tuple[float, float]:
        """Return the RMS position residual [m] and the RMS angle residual [rad] of a fit."""
        observations = observations or self.observations
        return errors_of(observations.sources, fit.residuals(observations))

    def before_after(self, observations: Observations) -> tuple[tuple[float, float], ...]:
        """Return `errors` before and after calibration."""
        fits = self.registration, self.fit
        return tuple(self.errors(fit, observations) for fit in fits)

    def marker_errors(self, observations: Observations) -> dict[str, float]:
        """Return the RMS position error of each marker or body [m]."""
        found = norms(observations.sources, self.fit.residuals(observations), 'm')
        return {name: float(np.sqrt(np.nanmean(own**2))) for name, own in found.items()}

    def joint_values(self, kind: str) -> dict[str, tuple[float, float]]:
        """Return the estimated error of one kind and its standard deviation, by joint name."""
        fit = self.fit
        deviations = fit.deviations
        found = {}
        for place, column in enumerate(fit.free):
            joint, _, own = fit.geometry.names[column].rpartition('.')
            if own == kind:
                found[joint] = (float(fit.errors[column]), float(deviations[place]))
        return found


def calibrate(
    chain: Chain,
    observations: Observations,
    held_out: Mapping[str, Observations] | None = None,
    level: str = 'auto',
    compliance: bool = True,
    tolerance: Tolerance | None = None,
) -> Calibration:
    """Estimate the geometric errors of an arm.

    Parameters
    ----------
    observations : Observations
        Joint positions of the chain's robot, with sensor measurements.
    held_out : mapping of str to Observations
        Postures for validation only by name, with the sources of `observations`.
    level : {'auto', 'offsets', 'geometry'}
        'offsets': estimate joint offsets only; 'geometry': estimate link geometry as well;
        'auto': the level that predicts held-out postures best.
    compliance : bool
        Whether to try models with joint deflection under gravity; requires a URDF with masses.
    tolerance : Tolerance
        Typical errors of the URDF.

    Raises
    ------
    CalibrationError
        If measurements are unusable, see `checks`, or too few errors are identifiable.
    """
    geometry = ArmGeometry(chain.robot, chain.link, tolerance)
    observations, messages = _without_copies(observations)
    others = {name: _like(name, one, observations) for name, one in (held_out or {}).items()}
    check_count(observations)
    every = (observations, *others.values())
    warnings = [check_positions(one, geometry) for one in every]
    messages += warnings[0]
    for one in every:
        check_units(one, geometry)
    check_rigid(*every)
    start = registered(geometry, observations)
    check_unknowns(start)
    offsets = identifiable(start, LEVELS['offsets'])
    check_misfit(fitted(start, offsets.columns))
    messages += check_offsets(start, offsets)
    if compliance and not chain.has_masses:
        compliance = False
        messages.append(
            'the URDF contains no masses, so the deflection of the joints under gravity is '
            'not estimated'
        )
    best, tried = chosen(start, level, compliance)
    kinds = LEVELS['geometry' if level == 'auto' else level]
    kinds = (*kinds, *(('compliance',) if compliance else ()))
    found = identifiable(start, kinds)
    if found.hidden:
        names = ', '.join(geometry.names[k] for k in found.hidden)
        messages.append(
            f'the postures do not determine the errors {names}, which keep their nominal values: '
            'record postures in which the neighbouring joints move further'
        )
    return Calibration(chain, start, best, tuple(tried), found, others, messages)


def _without_copies(observations: Observations) -> tuple[Observations, list[str]]:
    sources, messages = [], []
    for source in observations.sources:
        if isinstance(source, MarkerSource):
            source, notes = without_copies(source)
            messages += notes
        sources.append(source)
    return replace(observations, sources=tuple(sources)), messages


def _like(held_out: str, one: Observations, observations: Observations) -> Observations:
    """Return held-out postures with the markers in the order of the fitted observations."""
    sources = []
    for source in observations.sources:
        kind, name = type(source), source.name
        others = [s for s in one.sources if type(s) is kind and s.name == name]
        if not others:
            ignored = source.names if isinstance(source, MarkerSource) else (name,)
            raise CalibrationError(
                f'the held-out postures {held_out} have no measurements of {name}: add '
                f'measurements, or pass --ignore {" ".join(ignored)}'
            )
        other = others[0]
        if isinstance(source, MarkerSource):
            assert isinstance(other, MarkerSource)
            missing = [name for name in source.names if name not in other.names]
            if missing:
                raise CalibrationError(
                    f'{held_out} lacks measurements of marker {missing[0]}: add the columns of '
                    'this marker'
                )
            order = [other.names.index(name) for name in source.names]
            other = replace(other, names=source.names, position=other.position[:, order])
        sources.append(other)
    return replace(one, sources=tuple(sources))
