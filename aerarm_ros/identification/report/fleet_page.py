"""Page with the parameters of many arms over time, which shows drifts and deviating arms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from aerarm_ros.identification.assessment import weighted_line
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import Html, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import figure_html, plain_text, plotting_script

Row = Mapping[str, object]

STD = '_std'
_DAY = 86400.0  # [s]
_CLEAR = 4.0  # standard deviations
_LEAST_BAGS = 4  # smallest number of bags of one arm, for a trend
_LEAST_ARMS = 4  # smallest number of arms, to detect a deviating one
_LEAST_CHANGE = 0.05  # smallest reported change, relative to a parameter's magnitude
_NORMAL = 1.4826  # ratio of standard deviation to median absolute deviation, for normal noise
_SHOWN = 12  # number of parameters with a figure
_ERROR = 'validation_sdp_filtered'


@dataclass(frozen=True)
class Drift:
    """Parameter of one arm that changes with time.

    Attributes
    ----------
    change : float
        Change of the parameter from the first to the last bag, along a fitted line.
    mean : float
        Mean value of the parameter.
    deviations : float
        Change divided by its standard deviation.
    """

    arm: str
    parameter: str
    change: float
    mean: float
    deviations: float


@dataclass(frozen=True)
class OddArm:
    """Parameter in which one arm deviates from all others.

    Attributes
    ----------
    value : float
        Median of the parameter over the bags of this arm.
    others : float
        Median of the parameter over all arms.
    deviations : float
        Difference divided by its standard deviation, which includes the scatter of the other arms.
    """

    arm: str
    parameter: str
    value: float
    others: float
    deviations: float


def fleet_page(rows: Sequence[Row]) -> str:
    """Return the fleet page as HTML that opens offline.

    Parameters
    ----------
    rows : sequence of mapping
        Rows of the table of `identifier --each`.

    Raises
    ------
    IdentificationError
        If the plotting script is not installed.
    """
    good = [row for row in rows if row['status'] == 'ok']
    drifts, odd = find_drifts(good), find_odd_arms(good)
    arms = dict.fromkeys(str(row['arm']) for row in good)
    lead = (
        f'{len(good)} of {len(rows)} bags of {len(arms)} arms were identified; {len(drifts)} '
        f'parameters drift, {len(odd)} differ from the same parameters of the other arms.'
    )
    parts = [paragraph(lead, 'lead')]
    if failed := [row for row in rows if row['status'] != 'ok']:
        cells = [[str(row['bag']), str(row['reason'])] for row in failed]
        parts.append(section('Failed', table(['bag', 'reason'], cells)))
    if odd:
        cells_odd = [[o.arm, o.parameter, o.value, o.others, o.deviations] for o in odd]
        headings = ['arm', 'parameter', 'value', 'median of all arms', 'in deviations']
        parts.append(section('Arms that differ', table(headings, cells_odd)))
    if drifts:
        cells_drift = [[d.arm, d.parameter, d.change, d.mean, d.deviations] for d in drifts]
        headings = ['arm', 'parameter', 'change', 'mean', 'in deviations']
        parts.append(section('Drift', paragraph(_DRIFT, 'note'), table(headings, cells_drift)))
    if good:
        of_joints = [n for n in _parameters(good) if n.startswith(('fv_', 'fs_', 'Ja_'))]
        named = [*(d.parameter for d in drifts), *(o.parameter for o in odd)]
        shown = list(dict.fromkeys([*named, *of_joints]))[:_SHOWN]
        for number, name in enumerate([_ERROR, *shown]):
            parts.append(section(f'{name} over time', _figure(good, name, f'time-{number}')))
        parts.append(section('Bags', _bags(good)))
    return page('Fleet', plotting_script(), parts, origin())


_DRIFT = (
    'Each line is fitted to the values of one arm over the dates of its bags, weighted by their '
    'standard deviations. The column "change" contains the change along this line from the first '
    'to the last bag. '
    'Friction that changes with the gear temperature looks like drift, so record at the same '
    'temperature.'
)


def find_drifts(rows: Sequence[Row]) -> list[Drift]:
    """Return parameters that change with time, the most significant change first."""
    found = []
    for arm in dict.fromkeys(str(row['arm']) for row in rows):
        own = [row for row in rows if row['arm'] == arm and row['date']]
        days = np.array([_days(row) for row in own])
        if len(own) < _LEAST_BAGS or np.ptp(days) <= 0.0:
            continue
        for name in _parameters(own):
            drift = _drift(arm, name, days, *_column(own, name))
            if drift is not None:
                found.append(drift)
    return sorted(found, key=lambda drift: -abs(drift.deviations))


def find_odd_arms(rows: Sequence[Row]) -> list[OddArm]:
    """Return parameters in which one arm deviates from the others, the most significant first."""
    arms = list(dict.fromkeys(str(row['arm']) for row in rows))
    found = []
    for name in _parameters(rows) if len(arms) >= _LEAST_ARMS else ():
        medians, deviations = np.full(len(arms), np.nan), np.full(len(arms), np.nan)
        for index, arm in enumerate(arms):
            values, std = _column([row for row in rows if row['arm'] == arm], name)
            if np.isfinite(values).any():
                medians[index] = np.nanmedian(values)
                deviations[index] = np.nanmedian(std) / np.sqrt(np.isfinite(values).sum())
        middle = float(np.nanmedian(medians))
        spread = _NORMAL * float(np.nanmedian(np.abs(medians - middle)))
        off = (medians - middle) / np.maximum(np.hypot(deviations, spread), 1e-300)
        for index in np.flatnonzero(np.abs(np.nan_to_num(off)) > _CLEAR).tolist():
            value = float(medians[index])
            found.append(OddArm(arms[index], name, value, middle, float(off[index])))
    return sorted(found, key=lambda odd: -abs(odd.deviations))


def _drift(arm: str, name: str, days: Array, values: Array, std: Array) -> Drift | None:
    known = np.isfinite(values) & np.isfinite(std) & (std > 0.0)
    if known.sum() < _LEAST_BAGS or np.ptp(days[known]) <= 0.0:
        return None
    mean, slope, deviation = weighted_line(days[known], values[known], std[known])
    change, deviations = slope * float(np.ptp(days[known])), slope / deviation
    if abs(deviations) < _CLEAR or abs(change) < _LEAST_CHANGE * abs(mean):
        return None
    return Drift(arm, name, change, mean, deviations)


def _parameters(rows: Sequence[Row]) -> list[str]:
    names = dict.fromkeys(name for row in rows for name in row)
    return [name for name in names if name + STD in names]


def _column(rows: Sequence[Row], name: str) -> tuple[Array, Array]:
    """Return values and standard deviations (bags,) of a parameter; NaN for bags that lack it."""
    return tuple(  # type: ignore[return-value]
        np.array([np.nan if row.get(key) is None else row[key] for row in rows], dtype=float)
        for key in (name, name + STD)
    )


def _days(row: Row) -> float:
    return datetime.fromisoformat(str(row['date'])).timestamp() / _DAY


def _figure(rows: Sequence[Row], name: str, identifier: str) -> Html:
    """Return a figure of one parameter of all arms, over the dates or numbers of the bags."""
    traces = []
    for arm in dict.fromkeys(str(row['arm']) for row in rows):
        own = sorted((row for row in rows if row['arm'] == arm), key=lambda r: str(r['date']))
        values, std = _column(own, name)
        dates = [str(row['date']) if row['date'] else index for index, row in enumerate(own)]
        traces.append(
            {
                'type': 'scatter',
                'mode': 'lines+markers',
                'name': plain_text(arm),
                'x': dates,
                'y': [None if not np.isfinite(value) else float(value) for value in values],
                'error_y': {
                    'type': 'data',
                    'array': [0.0 if not np.isfinite(s) else float(s) for s in std],
                },
            }
        )
    return figure_html(identifier, traces, {'height': 320, 'template': 'none'})


def _bags(rows: Sequence[Row]) -> Html:
    headings = ['bag', 'arm', 'date', 'validation [%]', 'CAD with friction [%]', 'warnings']
    keys = ('bag', 'arm', 'date', _ERROR, 'validation_cad_friction_filtered')
    cells = [
        [*(_cell(row.get(key)) for key in keys), row.get('first_warning') or ''] for row in rows
    ]
    return table(headings, cells)


def _cell(value: object) -> object:
    return float(value) if isinstance(value, float) else '' if value is None else str(value)
