"""Report of a calibration as a page, and as a table for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerarm_ros.calibration.calibrate import Calibration
from aerarm_ros.calibration.choice import Candidate
from aerarm_ros.calibration.fit import Fit
from aerarm_ros.calibration.observations import Observations, norms
from aerarm_ros.pages.html_text import (
    Html,
    bullets,
    origin,
    page,
    paragraph,
    section,
    table,
    text_table,
)

_METRIC = (
    'Errors are root mean squares: of the distance between measured and predicted position, and '
    'of the angle between measured and predicted orientation. "Before" means the original URDF, '
    'with base frame and markers fitted to the training postures. Held-out postures are part of '
    'no fit.'
)
_CHOICE = (
    'Cross-validation: each model was fitted ten times. Each fit omitted another tenth of the '
    'postures and predicted the omitted postures. Estimates within 1.4 standard deviations of '
    'the nominal value are set to the nominal '
    'value. A larger model is chosen if its mean prediction error is smaller by more than half a '
    'standard error.'
)
_PARAMETERS = (
    'Offsets are added to recorded positions. x, y, z and the rotation vector rx, ry, rz '
    'displace the frame of a joint, along the axes of its nominal frame. Standard deviations '
    'account for correlation between the residuals of one posture.'
)
_ABSORBED = (
    'An indistinguishable error has the same effect on the measurements as the base frame, the '
    'markers or another error. No posture separates such errors, so an indistinguishable error '
    'keeps its nominal value.'
)


def calibration_html(calibration: Calibration, mapping: Sequence[str] = ()) -> str:
    """Return the report of a calibration as self-contained HTML that opens offline.

    Parameters
    ----------
    mapping : sequence of str
        Meaning of each input column or topic, as text.
    """
    body = [paragraph(headline(calibration), 'lead')]
    if calibration.messages:
        body.append(bullets(calibration.messages, 'warnings'))
    body += [
        section('Errors', paragraph(_METRIC, 'note'), _error_table(calibration)),
        section('By marker and direction', _channel_tables(calibration)),
        section('Choice of the model', paragraph(_CHOICE, 'note'), _candidate_table(calibration)),
        section('Estimates', paragraph(_PARAMETERS, 'note'), _estimate_table(calibration)),
        section('As drawn', _as_drawn(calibration)),
    ]
    if mapping:
        body.append(section('Input', bullets(mapping)))
    title = f'Calibration of {calibration.fit.geometry.link}'
    return page(title, '', body, origin())


def headline(calibration: Calibration) -> str:
    """Return the errors before and after calibration in one sentence."""
    observations, name = calibration.observations, 'in the fitted postures'
    if calibration.held_out:
        observations = next(iter(calibration.held_out.values()))
        name = f'in {len(observations)} held-out postures'
    before, after = calibration.before_after(observations)
    text = (
        f'Position error {name}: {1e3 * before[0]:.2f} mm before, {1e3 * after[0]:.2f} mm after '
        f'calibration ({calibration.best.name}, {len(calibration.fit.free)} estimated errors).'
    )
    if np.isfinite(after[1]):
        text += (
            f' Orientation error: {1e3 * before[1]:.2f} mrad before, {1e3 * after[1]:.2f} mrad '
            'after calibration.'
        )
    return text


def calibration_text(calibration: Calibration) -> str:
    """Return position errors, tried models and estimates as text for a terminal."""
    lines = [headline(calibration), '']
    names = ['model', 'errors', 'cross-validation', 'training']
    rows = [[*names, *calibration.held_out]]
    for one in calibration.tried:
        mark = ' *' if one is calibration.best else ''
        errors = _errors_of(calibration, one)
        shown = [f'{value:.3f}' if np.isfinite(value) else '-' for value in errors]
        rows.append([one.name + mark, str(len(one.fit.free)), *shown])
    lines += [text_table(rows), '(RMS position error [mm]; * marks the chosen model)', '']
    for name, observations in _groups(calibration).items():
        lines.append(_summed(calibration, name, observations))
    lines.append('')
    estimates = [
        [name, f'{value:+.3f}', f'± {deviation:.3f}', unit]
        for name, value, deviation, unit in _estimates(calibration.fit)
    ]
    return '\n'.join([*lines, text_table(estimates)])


def _errors_of(calibration: Calibration, one: Candidate) -> list[float]:
    """Return position errors [mm] of a model: cross-validation, training and held-out postures."""
    groups = calibration.groups.values()
    errors = [calibration.errors(one.fit, group)[0] for group in groups]
    return [1e3 * value for value in (one.position, *errors)]


def _summed(calibration: Calibration, name: str, observations: Observations) -> str:
    """Return the position errors of the markers in a group of postures as text."""
    markers = calibration.marker_errors(observations)
    listed = ', '.join(f'{key} {1e3 * value:.2f}' for key, value in markers.items())
    return f'{name}: {listed} mm'


def _estimates(fit: Fit) -> list[tuple[str, float, float, str]]:
    """Return name, value, standard deviation and unit (mm, mrad, mrad/Nm) of each estimate."""
    names, unit = fit.geometry.names, fit.geometry.unit
    return [
        (names[k], 1e3 * float(fit.errors[k]), 1e3 * float(deviation), f'm{unit(k)}')
        for k, deviation in zip(fit.free, fit.deviations, strict=False)
    ]


def _groups(calibration: Calibration) -> Mapping[str, Observations]:
    return {
        f'{name} ({len(group)} {"held-out " if number else ""}postures)': group
        for number, (name, group) in enumerate(calibration.groups.items())
    }


def _error_table(calibration: Calibration) -> Html:
    rows = []
    for name, observations in _groups(calibration).items():
        before, after = calibration.before_after(observations)
        largest = _largest(calibration.fit, observations)
        rows.append([name, 1e3 * before[0], 1e3 * after[0], 1e3 * largest,
                     1e3 * before[1], 1e3 * after[1]])  # fmt: skip
    headings = ['postures', 'before [mm]', 'after [mm]', 'largest after [mm]', 'before [mrad]',
                'after [mrad]']  # fmt: skip
    return table(headings, rows)


def _largest(fit: Fit, observations: Observations) -> float:
    """Return the largest position error after calibration [m]."""
    found = list(norms(observations.sources, fit.residuals(observations), 'm').values())
    return float(np.nanmax(np.concatenate(found), initial=0.0)) if found else 0.0


def _channel_tables(calibration: Calibration) -> Html:
    parts = []
    for name, observations in _groups(calibration).items():
        rows = []
        after = calibration.fit.residuals(observations)
        before = calibration.registration.residuals(observations)
        for source, one, other in zip(observations.sources, before, after, strict=True):
            for k, (channel, unit) in enumerate(source.channels):
                roots = [1e3 * float(np.sqrt(np.nanmean(x[:, k] ** 2))) for x in (one, other)]
                mean = 1e3 * float(np.nanmean(other[:, k]))
                rows.append([channel, *roots, mean, f'm{unit}'])
        headings = ['channel', 'RMS before', 'RMS after', 'mean after', 'unit']
        parts += [paragraph(_summed(calibration, name, observations)), table(headings, rows)]
    return Html(''.join(parts))


def _candidate_table(calibration: Calibration) -> Html:
    rows: list[list[object]] = []
    for one in calibration.tried:
        count = Html(str(len(one.fit.free)))
        rows.append([one.name, count, *_errors_of(calibration, one)])
    headings = ['model', 'errors', 'cross-validation [mm]', 'training [mm]']
    headings += [f'{name} [mm]' for name in calibration.held_out]
    return table(headings, rows, best=[list(calibration.tried).index(calibration.best)])


def _estimate_table(calibration: Calibration) -> Html:
    rows = _estimates(calibration.fit)
    if not rows:
        return paragraph('All geometric errors are insignificant: the arm matches its URDF.')
    return table(['error', 'estimate', 'standard deviation', 'unit'], rows)


def _as_drawn(calibration: Calibration) -> Html:
    titles = (
        'Errors that are insignificant or not part of the chosen model',
        'Errors that these postures do not determine',
        'Errors that are indistinguishable from other errors',
    )
    parts = [
        paragraph(f'{title}: {", ".join(listed) or "none"}.')
        for title, listed in zip(titles, calibration.as_drawn.values(), strict=True)
    ]
    return Html(''.join([*parts, paragraph(_ABSORBED, 'note')]))
