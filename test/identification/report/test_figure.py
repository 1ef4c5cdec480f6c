"""Figures as data for the plotting script."""

import json
import re

import numpy as np

from aerarm_ros.pages.plots import StackedFigure


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


def test_strings_cannot_leave_the_script() -> None:
    figure = StackedFigure(('</script><img src=x>',), 'Nm')
    figure.add(0, np.zeros(2), np.zeros(2), '</script>', 'residual')
    html = figure.html('x')
    assert html.count('</script>') == 1
    assert '<img' not in html
