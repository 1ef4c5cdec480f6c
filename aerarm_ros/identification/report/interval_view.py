"""What is known of each base parameter: where it is, and how surely."""

from typing import Any

import numpy as np

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.assessment.truth import Truth
from aerarm_ros.pages.html_text import Html
from aerarm_ros.pages.plots import figure_html, plain_text

_ROW = 17  # [px]
_NAME = 34  # characters of an expression that are shown
_DEVIATIONS = 2.0  # on either side: 95 %
_FARTHEST = 6.0  # standard deviations of CAD that are shown


def interval_view(result: IdentificationResult, truth: Truth | None) -> Html:
    """Return the figure: base parameters of the recommended estimate with their intervals.

    All on one scale: the distance from CAD, in standard deviations of what CAD leaves open.

    Parameters
    ----------
    result : IdentificationResult
    truth : Truth or None
        Of a simulated arm, shown beside.
    """
    base, prior = result.used_base, result.fit.prior.std
    names = [_short(text) for text in base.expressions()]
    open_left = np.sqrt(
        prior[base.independent] ** 2 + base.combination**2 @ prior[base.dependent] ** 2
    )
    scale = np.maximum(open_left, 1e-300)
    cad = base.values(result.cad.vector(result.fit.model))
    found = base.values(result.recommended.estimate.theta)
    place = (found - cad) / scale
    spread = np.minimum(_DEVIATIONS * result.base_deviations / scale, 1e3)
    # What the motion says nothing of has bars beyond all others.
    reach = float(np.clip(1.2 * np.abs(place).max(initial=0.0), 1.0, _FARTHEST))
    traces: list[dict[str, Any]] = [
        {
            'type': 'scatter',
            'mode': 'markers',
            'name': 'sdp, 95 %',
            'x': place.round(5).tolist(),
            'y': names,
            'error_x': {'type': 'data', 'array': spread.round(5).tolist()},
            'marker': {'color': '#0b4fa3', 'size': 6},
        }
    ]
    if truth is not None:
        true = (truth.base_values(result.fit, base) - cad) / scale
        known = np.isfinite(true)
        traces.append(
            {
                'type': 'scatter',
                'mode': 'markers',
                'name': 'true',
                'x': true[known].round(5).tolist(),
                'y': [name for name, shown in zip(names, known, strict=True) if shown],
                'marker': {'color': '#0b7a3b', 'symbol': 'x', 'size': 7},
            }
        )
    layout = {
        'height': _ROW * len(names) + 110,
        'margin': {'l': 260, 'r': 15, 't': 30, 'b': 45},
        'template': 'none',
        'legend': {'orientation': 'h', 'y': 1.0, 'yanchor': 'bottom'},
        'xaxis': {
            'title': {'text': 'distance from CAD, in its standard deviations'},
            'range': [-reach, reach],
        },
        'yaxis': {'autorange': 'reversed', 'tickfont': {'size': 11}, 'type': 'category'},
    }
    return figure_html('intervals', traces, layout)


def _short(expression: str) -> str:
    text = expression if len(expression) <= _NAME else expression[: _NAME - 1] + '…'
    return plain_text(text)
