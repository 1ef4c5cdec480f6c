"""Robust nonlinear least-squares fit of geometric errors, with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import Observations, register, sigma
from aerarm_ros.motion.signals import Array

LENGTH, ANGLE = 1e-3, 5e-3  # [m], [rad] assumed measurement noise in the first iteration of a fit
# [m], [rad] lower bounds of the estimated measurement noise
_LEAST_LENGTH, _LEAST_ANGLE = 1e-7, 1e-7
_OUTLIER = 3.0  # standard deviations above which a residual has reduced weight
_ROUNDS = 10
_SETTLED = 0.03  # relative change of the estimated noise at which the iteration ends
_MAD = 1.4826
_STEP = 0.01  # [m], [rad] scale of the sources' unknowns (base frame, markers)


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimated geometric errors of an arm, base frames and marker positions.

    Attributes
    ----------
    observations : Observations
        Fitted observations.
    free : tuple of int
        Indices of the estimated errors in `geometry.names`; all other errors are zero.
    states : tuple of ndarray
        Estimated unknowns of each source, for example base frame and marker positions.
    length, angle : float
        Standard deviation of measured positions [m] and angles [rad], from the residuals.
    repeats : float
        Number of measurements of a posture that contain as much information as one independent
        measurement (design effect, Kish 1965), from the correlation of the residuals.
    """

    geometry: ArmGeometry
    observations: Observations
    free: tuple[int, ...]
    errors: Array
    states: tuple[Array, ...]
    length: float = LENGTH
    angle: float = ANGLE
    repeats: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated geometric errors, then of the unknowns of all sources."""
        unknowns = [name for s in self.observations.sources for name in s.unknowns]
        return (*(self.geometry.names[k] for k in self.free), *unknowns)

    def residuals(self, observations: Observations | None = None) -> list[Array]:
        """Return the residuals (M, K) of each source [m], [rad]; default: the fitted postures."""
        observations = observations or self.observations
        poses = self.geometry.poses(observations.q, self.errors)
        return [
            source.residuals(poses, state)
            for source, state in zip(observations.sources, self.states, strict=True)
        ]

    def jacobian(self) -> list[Array]:
        """Return the derivatives of `residuals` by the free errors and all unknowns, per source."""
        observations, free, begin = self.observations, list(self.free), len(self.free)
        poses = self.geometry.poses(observations.q, self.errors)
        poses = replace(poses, jacobian=poses.jacobian[:, :, free])
        found = []
        for source, state in zip(observations.sources, self.states, strict=True):
            by_errors, by_unknowns = source.jacobians(poses, state)
            jacobian = np.zeros((*by_errors.shape[:2], len(self.names)))
            end = begin + by_unknowns.shape[2]
            jacobian[:, :, : len(free)] = by_errors
            jacobian[:, :, begin:end] = by_unknowns
            begin = end
            found.append(jacobian)
        return found

    @cached_property
    def covariance(self) -> Array:
        """Covariance matrix of the estimated errors and unknowns, in the order of `names`.

        Each standard deviation is the larger of two: that of `repeats` equal residuals, and that
        of the observed correlation within a posture (cluster-robust, Liang and Zeger 1986, with
        the correction for few clusters).
        """
        rows, residuals, clusters = self._weighted()
        rows, residuals = rows / np.sqrt(self.repeats), residuals / np.sqrt(self.repeats)
        information = rows.T @ rows
        prior = np.zeros(rows.shape[1])
        prior[: len(self.free)] = 1.0 / self.geometry.typical[list(self.free)] ** 2
        inverse = _inverse(information + np.diag(prior))
        number, width = rows.shape
        groups = np.unique(clusters)
        scores = np.array([rows[clusters == k].T @ residuals[clusters == k] for k in groups])
        few = len(groups) / max(len(groups) - 1, 1) * (number - 1) / max(number - width, 1)
        robust = few * np.sum((scores @ inverse) ** 2, axis=0)
        plain = np.diag(inverse)
        ratio = np.sqrt(np.maximum(robust, plain) / np.maximum(plain, 1e-300))
        return inverse * np.outer(ratio, ratio)

    @property
    def deviations(self) -> Array:
        """Standard deviations of the estimated errors and unknowns, in the order of `names`."""
        return np.sqrt(np.diag(self.covariance))

    def _weighted(self) -> tuple[Array, Array, Array]:
        """Return weighted Jacobian rows, weighted residuals, and the posture number of each row.

        Residuals are in standard deviations, and postures are indices of `observations`. Missing
        readings are left out.
        """
        rows, residuals, clusters = [], [], []
        jacobians = self.jacobian()
        sources = self.observations.sources
        for source, residual, jacobian in zip(sources, self.residuals(), jacobians, strict=True):
            scaled = residual / sigma(source, self.length, self.angle)
            root = (1.0 + (scaled / _OUTLIER) ** 2) ** -0.25
            seen = np.isfinite(scaled)
            scale = (root / sigma(source, self.length, self.angle))[:, :, None]
            rows.append((jacobian * scale)[seen])
            residuals.append((scaled * root)[seen])
            posture = np.arange(len(scaled))[:, None]
            clusters.append(np.broadcast_to(posture, scaled.shape)[seen])
        return np.vstack(rows), np.concatenate(residuals), np.concatenate(clusters)


def registered(geometry: ArmGeometry, observations: Observations) -> Fit:
    """Fit only the base frames and marker positions; the arm keeps its nominal geometry."""
    errors = np.zeros(len(geometry.names))
    poses = geometry.poses(observations.q, errors)
    states = tuple(register(source, poses) for source in observations.sources)
    return fitted(Fit(geometry, observations, (), errors, states), ())


def fitted(start: Fit, free: Sequence[int], observations: Observations | None = None) -> Fit:
    """Fit the geometric errors `free`, and the base frames and marker positions of all sources.

    The loss is ``soft_l1`` beyond three standard deviations. The estimate maximizes the posterior
    probability. The prior of each geometric error has the standard deviation
    `ArmGeometry.typical`; it is about normal up to three standard deviations, with linear tails.
    Noise and correlation of the measurements are estimated from the residuals, so the fit is
    repeated until both converge.

    Parameters
    ----------
    start : Fit
        Initial fit; errors that are not free become zero.
    observations : Observations, optional
        Observations to fit; by default those of the initial fit.
    """
    errors = np.zeros_like(start.errors)
    errors[list(free)] = start.errors[list(free)]
    fit = replace(
        start,
        observations=observations or start.observations,
        free=tuple(free),
        errors=errors,
        # The noise of a fit with fewer errors contains errors of the arm: with such noise the
        # prior outweighs the measurements, and the iteration converges near the URDF.
        length=min(start.length, LENGTH),
        angle=min(start.angle, ANGLE),
        repeats=1.0,
    )
    for _ in range(_ROUNDS):
        before = np.array([fit.length, fit.angle, fit.repeats])
        fit = _with_noise(_solved(fit))
        after = np.array([fit.length, fit.angle, fit.repeats])
        if np.max(np.abs(np.log(after / before))) < _SETTLED:
            break
    return fit


def free_columns(fit: Fit, columns: Sequence[int]) -> Array:
    """Return the derivatives of the residuals by the errors `columns` and all unknowns.

    Each row is divided by the measurement noise, and each column is multiplied by the typical
    size of its error: (N, errors + unknowns).
    """
    probe = replace(fit, free=tuple(columns), length=LENGTH, angle=ANGLE)
    rows, _, _ = probe._weighted()
    rows[:, : len(columns)] *= fit.geometry.typical[list(columns)]
    rows[:, len(columns) :] *= _STEP
    return rows


def _solved(fit: Fit) -> Fit:
    sources, typical = fit.observations.sources, fit.geometry.typical[list(fit.free)]
    scales = np.concatenate([typical, np.full(len(fit.names) - len(fit.free), _STEP)])
    prior = typical / np.sqrt(fit.repeats)

    def residuals(step: Array) -> Array:
        there = _stepped(fit, step)
        parts = [
            (r / sigma(s, fit.length, fit.angle))[np.isfinite(r)]
            for r, s in zip(there.residuals(), sources, strict=True)
        ]
        return np.concatenate([*parts, there.errors[list(fit.free)] / prior])

    def jacobian(step: Array) -> Array:
        there = _stepped(fit, step)
        parts = [
            (j / sigma(s, fit.length, fit.angle)[:, None])[np.isfinite(r)]
            for j, r, s in zip(there.jacobian(), there.residuals(), sources, strict=True)
        ]
        known = np.zeros((len(fit.free), len(step)))
        known[:, : len(fit.free)] = np.diag(1.0 / prior)
        return np.vstack([*parts, known])

    result = least_squares(
        residuals,
        np.zeros(len(scales)),
        jacobian,
        x_scale=scales,
        loss='soft_l1',
        f_scale=_OUTLIER,
        max_nfev=20,
        ftol=1e-7,
        xtol=1e-9,
        gtol=1e-9,
    )
    return _stepped(fit, result.x)


def _stepped(fit: Fit, step: Array) -> Fit:
    errors = fit.errors.copy()
    errors[list(fit.free)] += step[: len(fit.free)]
    states, begin = [], len(fit.free)
    for source, state in zip(fit.observations.sources, fit.states, strict=True):
        end = begin + len(source.unknowns)
        states.append(source.moved(state, step[begin:end]))
        begin = end
    return replace(fit, errors=errors, states=tuple(states))


def _with_noise(fit: Fit) -> Fit:
    """Return the fit with measurement noise and correlation estimated from its residuals.

    The noise is estimated by the median absolute deviation.
    """
    number, noise = 0, {'m': [], 'rad': []}  # type: ignore[var-annotated]
    for source, residual in zip(fit.observations.sources, fit.residuals(), strict=True):
        for k, (_, unit) in enumerate(source.channels):
            seen = residual[np.isfinite(residual[:, k]), k]
            noise[unit].append(seen)
            number += len(seen)
    left = max(number - len(fit.names), 1)
    correction = np.sqrt(number / left)
    found = []
    for unit, least, known in (('m', _LEAST_LENGTH, fit.length), ('rad', _LEAST_ANGLE, fit.angle)):
        if not any(map(len, noise[unit])):
            found.append(known)
            continue
        values = np.concatenate(noise[unit])
        found.append(max(least, float(correction) * _scale(values)))
    fit = replace(fit, length=found[0], angle=found[1])
    return replace(fit, repeats=_repeats(fit))


def _repeats(fit: Fit) -> float:
    """Return the mean design effect of all sources, for the attribute `Fit.repeats`.

    The independent measurements of a posture are counted by the participation ratio
    ``tr(S)^2 / tr(S^2)`` of the residuals' second moments S, without the bias of a finite number
    of postures.
    """
    factors, counts = [], []
    for source, residual in zip(fit.observations.sources, fit.residuals(), strict=True):
        seen = np.isfinite(residual).astype(float)
        scaled = np.nan_to_num(residual) / sigma(source, fit.length, fit.angle)
        scaled = np.clip(scaled, -_OUTLIER, _OUTLIER)
        moments = scaled.T @ scaled / np.maximum(seen.T @ seen, 1.0)
        size, trace = len(moments), float(np.trace(moments))
        number = float(seen.any(axis=1).sum())
        if not number:
            continue
        squares = (np.sum(moments**2) - trace**2 / number) / (1.0 + 1.0 / number)
        factors.append(float(np.clip(size * squares / max(trace**2, 1e-300), 1.0, size)))
        counts.append(float(seen.sum()))
    return float(np.average(factors, weights=counts)) if counts else 1.0


def _scale(values: Array) -> float:
    """Return the standard deviation of values without outliers."""
    scale = _MAD * float(np.median(np.abs(values)))
    if scale == 0.0:
        return float(np.sqrt(np.mean(values**2)))
    kept = values[np.abs(values) < _OUTLIER * scale]
    return float(np.sqrt(np.mean(kept**2))) * 1.0075 if len(kept) else scale


def _inverse(matrix: Array) -> Array:
    """Return the inverse of a symmetric matrix with rows of widely different magnitude."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(size, size)
    inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
    return np.asarray(inverse / np.outer(size, size))
