"""Page with plots of the energy campaign."""

from typing import Any

import numpy as np
from energy_moves.energy_figures import COLUMNS, GOALS, SAVINGS, EnergyFigures
from energy_moves.move import PLANNED, TRAPEZOID
from flying.pages import figure

from aerarm_ros.pages.html_text import Html, bullets, paragraph, section, table
from aerarm_ros.planner.motion_plan import QUINTIC

OTHERS = (QUINTIC, TRAPEZOID)


def energy_page(
    found: EnergyFigures, standby: float, watt_hours: float, note: str, refused: list[str]
) -> list[str]:
    """Return the page of the energy campaign as HTML.

    Parameters
    ----------
    found
        Measured figures.
    standby
        Power of the boards without motor current [W].
    watt_hours
        Energy of the battery [Wh].
    note
        Description of the played moves.
    refused
        Moves that were not completed, with the reason.
    """
    names = list(found.by_shape)
    rows = found.rows(standby, watt_hours)
    body = [
        paragraph(note, 'lead'),
        paragraph(GOALS, 'note'),
        section('Energy per move', table(['shape', *COLUMNS], rows, [names.index(PLANNED)])),
        section('Saving by planning', table(['than the', *SAVINGS], found.savings())),
        section('Energy of a move', _against(found)),
        section('Saving and duration', _saving(found)),
        section('Predicted and measured', _predicted(found)),
        section('Tracking error', _tracking(found)),
    ]
    if refused:
        body.append(section('Not played', bullets(refused)))
    return body


def _against(found: EnergyFigures) -> Html:
    planned = found.column(PLANNED, 'measured')
    top = float(found.column(QUINTIC, 'measured').max())
    traces = [_points(other, found.column(other, 'measured'), planned) for other in OTHERS]
    for name, share in (('as much', 1.0), ('half', 0.5)):
        line = {'dash': 'dash', 'width': 1}
        ends: dict[str, Any] = {'x': [0.0, top], 'y': [0.0, share * top], 'line': line}
        traces.append({'type': 'scatter', 'mode': 'lines', 'name': name, **ends})
    return figure('against', traces, 'other shape, same duration [J]', 'planned [J]')


def _saving(found: EnergyFigures) -> Html:
    duration = found.column(PLANNED, 'duration')
    traces = [_points(f'than {x}', duration, 100.0 * found.saving(x)) for x in OTHERS]
    return figure('saving', traces, 'duration [s]', 'less [%]')


def _predicted(found: EnergyFigures) -> Html:
    traces = []
    for shape in found.by_shape:
        measured = found.column(shape, 'measured')
        off = 100.0 * (found.column(shape, 'predicted') / measured - 1.0)
        traces.append(_points(shape, measured, off))
    return figure('predicted', traces, 'measured [J]', 'predicted minus measured [%]')


def _tracking(found: EnergyFigures) -> Html:
    traces = [
        {'type': 'box', 'y': np.round(found.column(shape, 'rms'), 3).tolist(), 'name': shape}
        for shape in found.by_shape
    ]
    return figure('tracking', traces, '', 'RMS error of a move [mrad]')


def _points(name: str, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    places = {'x': np.round(x, 3).tolist(), 'y': np.round(y, 3).tolist()}
    return {'type': 'scatter', 'mode': 'markers', 'name': name, **places}
