"""Figures as data for the plotting script."""

import base64
import gzip
import json
import re

import numpy as np
import pytest

from aerarm_ros.pages.plots import StackedFigure, plotting_script


def arguments(html: str) -> tuple:
    (call,) = re.findall(r'Plotly\.newPlot\((.*)\)\);</script>', html)
    return tuple(json.loads(f'[{call}]'))


def test_curves_go_to_their_joints_axes() -> None:
    figure = StackedFigure(('joint1', 'joint2'), 'Nm')
    x = np.linspace(0.0, 1.0, 11)
    for row in range(2):
        figure.add(row, x, x**2, 'measured', 'measured')
    identifier, traces, layout, _ = arguments(figure.html('tau-0'))
    assert identifier == 'tau-0'
    assert [trace['yaxis'] for trace in traces] == ['y', 'y2']
    assert [trace['showlegend'] for trace in traces] == [True, False]
    assert np.allclose(traces[1]['y'], x**2)
    assert layout['yaxis']['domain'][0] > layout['yaxis2']['domain'][1]
    assert layout['yaxis2']['title']['text'] == 'joint2 [Nm]'


def test_long_curves_are_thinned_out() -> None:
    figure = StackedFigure(('a',), 'Nm')
    figure.add(0, np.arange(1e6), np.arange(1e6), 'b', 'predicted')
    _, traces, _, _ = arguments(figure.html('x'))
    assert len(traces[0]['y']) <= 2000
    # Evenly spread points are told by the first and their distance.
    assert traces[0]['dx'] * (len(traces[0]['y']) - 1) == pytest.approx(1e6, rel=2e-3)


def test_strings_cannot_leave_the_script() -> None:
    figure = StackedFigure(('</script><img src=x>',), 'Nm')
    figure.add(0, np.zeros(2), np.zeros(2), '</script>', 'residual')
    html = figure.html('x')
    assert html.count('</script>') == 1
    assert '<img' not in html


def test_the_plotting_library_is_carried_along() -> None:
    (packed,) = re.findall(r"atob\('([^']*)'\)", plotting_script())
    assert len(packed) < 2_100_000
    script = gzip.decompress(base64.b64decode(packed)).decode()
    assert len(script) > 1_000_000
    assert 'Plotly' in script
