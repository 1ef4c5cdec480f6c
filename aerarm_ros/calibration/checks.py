"""Checks of the measurements of a calibration; a failed check raises an error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from aerarm_ros.calibration.fit import Fit, registered
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import CalibrationError, MarkerSource, Observations
from aerarm_ros.motion.signals import Array

FEWEST = 6
"""Smallest number of postures for a calibration."""

_JUMP = 5e-3  # [m] tolerated change of the distance between two markers on a rigid body
# a smaller change of a distance, in median absolute deviations, is not a marker jump
_SPREADS = 6.0
_ALIKE = 1e-6  # [m] closer markers are duplicates
_MILLIMETRES = (300.0, 3000.0)  # ratio of measured to predicted motion
_MISFIT = 0.05  # fraction of the measured marker motion that the nominal arm may leave unexplained
_LEAST_MISFIT = 3e-3  # [m]
_LARGEST_TURN = 12.0  # [rad] joint position above which the unit must be degrees
_FAR, _FAR_SIGMAS = 0.02, 15.0  # [m] and standard deviations of a single marker's jump
_EXPLAINED = 0.2  # remaining fraction of the misfit after exchanging markers or inverting a joint


def without_copies(source: MarkerSource) -> tuple[MarkerSource, list[str]]:
    """Return the markers without duplicate markers, and a message about each duplicate."""
    kept: list[int] = []
    messages = []
    for k, name in enumerate(source.names):
        same = next((j for j in kept if _same(source.position[:, j], source.position[:, k])), None)
        if same is None:
            kept.append(k)
        else:
            messages.append(
                f'marker {name} has the same values as {source.names[same]} in every posture and '
                'is ignored'
            )
    names = tuple(source.names[k] for k in kept)
    return MarkerSource(source.name, names, source.position[:, kept]), messages


def _same(one: Array, other: Array) -> bool:
    difference = np.abs(one - other)
    return bool(np.isfinite(difference).any() and np.nanmax(difference) < _ALIKE)


def check_count(observations: Observations) -> None:
    """Check that enough postures have measurements, and that every marker has a measurement.

    Raises
    ------
    CalibrationError
        If there are too few, or none of a marker or source.
    """
    seen = np.any([source.seen for source in observations.sources], axis=0)
    if int(seen.sum()) < FEWEST:
        raise CalibrationError(
            f'only {int(seen.sum())} postures have measurements, fewer than the minimum of '
            f'{FEWEST}: record at least 15 postures (40 are better)'
        )
    for source in observations.sources:
        measured = {source.name: source.seen}
        if isinstance(source, MarkerSource):
            measured = {
                name: np.isfinite(source.position[:, k]) for k, name in enumerate(source.names)
            }
        for name, own in measured.items():
            if not own.any():
                raise CalibrationError(
                    f'{name} has no measurement in any posture: pass --ignore {name}'
                )


def check_positions(observations: Observations, geometry: ArmGeometry) -> list[str]:
    """Return warnings about recorded joint positions beyond the joint limits of the URDF.

    Raises
    ------
    CalibrationError
        If positions are missing or in degrees.
    """
    messages = []
    robot = geometry.robot
    for i, joint in enumerate(geometry.joint_names):
        q = observations.q[:, i]
        if not np.isfinite(q).all():
            row = int(np.flatnonzero(~np.isfinite(q))[0])
            raise CalibrationError(
                f'{observations.labels[row]} has no position of joint {joint}: add the value, or '
                'remove the posture'
            )
        if not geometry.is_prismatic(i) and np.abs(q).max() > _LARGEST_TURN:
            raise CalibrationError(
                f'joint {joint} reaches {np.abs(q).max():.0f} rad: positions look like degrees; '
                f'pass --degrees, or state the unit in the column name, as in {joint} [deg]'
            )
        beyond = max(q.max() - robot.position_max[i], robot.position_min[i] - q.min())
        if beyond > 0.1:
            unit = 'm' if geometry.is_prismatic(i) else 'rad'
            messages.append(
                f'the recorded positions of joint {joint} exceed the limits of the URDF '
                f'by {beyond:.2g} {unit}'
            )
    return messages


def check_units(observations: Observations, geometry: ArmGeometry) -> None:
    """Check that the measured motion of markers is about as large as the motion of the model.

    Raises
    ------
    CalibrationError
        If the measurements look like millimetres.
    """
    predicted = _spread(geometry.poses(observations.q, np.zeros(len(geometry.names))).position)
    for source in observations.sources:
        position = source.position
        if position.ndim == 3:
            position = position[:, 0]
        measured = _spread(position)
        if predicted > 0.0 and _MILLIMETRES[0] < measured / predicted < _MILLIMETRES[1]:
            raise CalibrationError(
                f'{source.name}: measured positions vary by {measured:.0f}, but the arm moves by '
                f'{predicted:.2g} m, so the positions look like millimetres; pass --length-unit '
                'mm, or state the unit in the column names, as in x1 [mm]'
            )


def check_rigid(observations: Observations, *held_out: Observations) -> None:
    """Check that the distances between markers are equal in all fitted and held-out postures.

    Raises
    ------
    CalibrationError
        If markers are exchanged in some postures, or a marker jumps; the message names markers and
        posture.
    """
    every = (observations, *held_out)
    labels = [label for one in every for label in one.labels]
    for sources in zip(*(one.sources for one in every), strict=True):
        markers = [source for source in sources if isinstance(source, MarkerSource)]
        if markers and len(markers[0].names) > 1:
            positions = np.concatenate([source.position for source in markers])
            _check_distances(markers[0].names, positions, labels)


def _check_distances(names: Sequence[str], positions: Array, labels: Sequence[str]) -> None:
    pairs = list(combinations(range(len(names)), 2))
    distance = np.array([_distances(positions, pair) for pair in pairs])
    together = np.isfinite(distance).any(axis=1)  # some markers are never visible at the same time
    pairs, distance = (
        [p for p, is_seen in zip(pairs, together, strict=True) if is_seen],
        (distance[together]),
    )
    if not pairs:
        return
    usual = np.nanmedian(distance, axis=1)
    spread = 1.4826 * np.nanmedian(np.abs(distance - usual[:, None]), axis=1)
    limit = np.maximum(_JUMP, _SPREADS * spread)
    wrong = np.abs(distance - usual[:, None]) > limit[:, None]
    rows = np.flatnonzero(wrong.any(axis=0))
    if not len(rows):
        return
    row, where = int(rows[0]), _where(labels, rows)
    for one, other in pairs:
        swapped = _exchanged(positions[row], one, other)
        after = np.array([_distances(swapped[None], pair)[0] for pair in pairs])
        if not np.any(np.abs(after - usual) > limit):
            raise _swapped(where, names[one], names[other])
    counts = [sum(wrong[k, row] for k, pair in enumerate(pairs) if m in pair)
              for m in range(len(names))]  # fmt: skip
    marker = int(np.argmax(counts))
    off = np.nanmax(
        [abs(distance[k, row] - usual[k]) for k, pair in enumerate(pairs) if marker in pair]
    )
    # The distance of a single pair does not show which of its markers jumps.
    suspects = [name for name, n in zip(names, counts, strict=True) if n == max(counts)]
    who = f'marker {" or ".join(suspects)}'
    raise CalibrationError(
        f'{where}: {who} jumps by {1e3 * off:.0f} mm relative to the other markers; leave the '
        'cells of this marker empty in these postures, or remove the marker with --ignore '
        f'{names[marker]}'
    )


def check_misfit(fit: Fit) -> None:
    """Check that the URDF matches the arm, and that no markers jump or are swapped.

    Parameters
    ----------
    fit : Fit
        Fit with joint offsets.

    Raises
    ------
    CalibrationError
        If one of these faults explains the misfit.
    """
    observations, geometry = fit.observations, fit.geometry
    reach = _spread(geometry.poses(observations.q, fit.errors).position)
    for source, residual in zip(observations.sources, fit.residuals(), strict=True):
        lengths = [k for k, (_, unit) in enumerate(source.channels) if unit == 'm']
        values = residual[:, lengths]
        typical = float(np.sqrt(3.0) * np.nanmedian(np.abs(values)) * 1.4826)
        if typical > max(_MISFIT * reach, _LEAST_MISFIT):
            raise CalibrationError(_wrong_urdf(fit, typical, reach))
        if isinstance(source, MarkerSource):
            _check_single(source, fit, values)


def _check_single(source: MarkerSource, fit: Fit, residual: Array) -> None:
    """Raise an error if two markers are swapped in a few postures, or a marker jumps."""
    vectors = residual.reshape(len(residual), len(source.names), 3)
    off = np.linalg.norm(vectors, axis=2)
    far = np.nan_to_num(off) > max(_FAR, _FAR_SIGMAS * fit.length)
    rows = np.flatnonzero(far.any(axis=1))
    if not len(rows):
        return
    row, where = int(rows[0]), _where(fit.observations.labels, rows)
    predicted = vectors[row] + source.position[row]
    before = float(np.nansum(vectors[row] ** 2))
    for one, other in combinations(range(len(source.names)), 2):
        swapped = _exchanged(source.position[row], one, other)
        if float(np.nansum((predicted - swapped) ** 2)) < _EXPLAINED**2 * before:
            raise _swapped(where, source.names[one], source.names[other])
    marker = int(np.nanargmax(off[row]))
    raise CalibrationError(
        f'{where}: marker {source.names[marker]} jumps by '
        f'{1000.0 * off[row, marker]:.0f} mm relative to the other postures; leave the cells of '
        'this marker empty in these postures, or remove postures in which the arm moved'
    )


def _exchanged(position: Array, one: int, other: int) -> Array:
    """Return positions (markers, 3) with two markers exchanged."""
    swapped = position.copy()
    swapped[[one, other]] = swapped[[other, one]]
    return swapped


def _where(labels: Sequence[str], rows: npt.NDArray[np.intp]) -> str:
    """Return the label of the first of several postures, with the number of the others."""
    return labels[int(rows[0])] + (f' (and in {len(rows) - 1} more)' if len(rows) > 1 else '')


def _swapped(where: str, one: str, other: str) -> CalibrationError:
    return CalibrationError(
        f'{where}: markers {one} and {other} are swapped; exchange both markers in these rows, or '
        'label them again in the motion capture software'
    )


def _wrong_urdf(fit: Fit, typical: float, reach: float) -> str:
    text = (
        f'the URDF does not describe this arm: the link moves by {1e3 * reach:.0f} mm, but the '
        f'model leaves {1e3 * typical:.0f} mm unexplained'
    )
    joint = _turning_back(fit, typical)
    if joint:
        return (
            f'{text}; joint {joint} may turn in the opposite direction: check sign and axis of '
            'this joint'
        )
    return (
        f'{text}; check that the URDF, joint columns, units and the marker link (--link '
        f'{fit.geometry.link}) belong together'
    )


def _turning_back(fit: Fit, typical: float) -> str:
    """Return the joint whose reversed sign would explain most of the misfit; '' if none would."""
    observations = fit.observations
    for i, joint in enumerate(fit.geometry.joint_names):
        q = observations.q.copy()
        q[:, i] = -q[:, i]
        other = registered(fit.geometry, replace(observations, q=q))
        if np.sqrt(3.0) * other.length < _EXPLAINED * typical:
            return joint
    return ''


def _distances(position: Array, pair: tuple[int, int]) -> Array:
    return np.asarray(np.linalg.norm(position[:, pair[0]] - position[:, pair[1]], axis=1))


def _spread(position: Array) -> float:
    """Return the RMS distance of positions from their median [m]."""
    seen = position[np.isfinite(position).all(axis=1)]
    if not len(seen):
        return 0.0
    return float(np.sqrt(np.median(np.sum((seen - np.median(seen, axis=0)) ** 2, axis=1))))
