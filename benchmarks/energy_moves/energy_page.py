"""The campaign as a page with plots."""

import numpy as np
import plotly.graph_objects as go
from energy_moves.energy_figures import EnergyFigures
from energy_moves.move import PLANNED, TRAPEZOID

from aerarm_ros.pages.html_text import Html, page, paragraph, section
from aerarm_ros.pages.plots import plotting_script
from aerarm_ros.planner.plan_settings import QUINTIC


def energy_page(found: EnergyFigures, text: str, note: str) -> str:
    """Return the page as HTML."""
    figures = {
        'Energy of a move': _against(found),
        'Saving and duration': _saving(found),
        'Predicted and measured': _predicted(found),
        'Tracking error': _tracking(found),
    }
    sections = [section(name, _html(figure)) for name, figure in figures.items()]
    return page(
        'Energy of motions',
        plotting_script(),
        [paragraph(note, 'lead'), Html(f'<pre>{text}</pre>'), *sections],
    )


def _against(found: EnergyFigures) -> go.Figure:
    planned = found.column(PLANNED, 'measured')
    figure = go.Figure()
    for other in (QUINTIC, TRAPEZOID):
        figure.add_scatter(x=found.column(other, 'measured'), y=planned, mode='markers', name=other)
    top = float(found.column(QUINTIC, 'measured').max())
    figure.add_scatter(x=[0, top], y=[0, top], mode='lines', name='as much')
    figure.add_scatter(x=[0, top], y=[0, top / 2], mode='lines', name='half')
    return _titled(figure, 'other shape, same duration [J]', 'planned [J]')


def _saving(found: EnergyFigures) -> go.Figure:
    figure = go.Figure()
    for other in (QUINTIC, TRAPEZOID):
        saving = np.round(100.0 * found.saving(other), 2)
        figure.add_scatter(
            x=found.column(PLANNED, 'duration'), y=saving, mode='markers', name=f'than {other}'
        )
    return _titled(figure, 'duration [s]', 'less [%]')


def _predicted(found: EnergyFigures) -> go.Figure:
    figure = go.Figure()
    for shape in found.by_shape:
        measured = found.column(shape, 'measured')
        off = 100.0 * (found.column(shape, 'predicted') / measured - 1.0)
        figure.add_scatter(x=measured, y=np.round(off, 2), mode='markers', name=shape)
    return _titled(figure, 'measured [J]', 'predicted beyond measured [%]')


def _tracking(found: EnergyFigures) -> go.Figure:
    figure = go.Figure()
    for shape in found.by_shape:
        figure.add_box(y=np.round(found.column(shape, 'rms'), 3), name=shape)
    return _titled(figure, '', 'RMS error of a move [mrad]')


def _titled(figure: go.Figure, x: str, y: str) -> go.Figure:
    figure.update_layout(height=450, xaxis_title=x, yaxis_title=y)
    return figure


def _html(figure: go.Figure) -> Html:
    return Html(figure.to_html(full_html=False, include_plotlyjs=False))
