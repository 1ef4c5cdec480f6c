"""Plots of a page, drawn in the browser by the plotting library that the page carries."""

from __future__ import annotations

import base64
import gzip
import importlib.util
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from aerarm_ros.pages.html_text import Html

# Packed, the library is 2 of its 5 MB. It is run as a classic script, as it asks for, once it is
# unpacked; figures wait for that, those too that plotly wrote. They are drawn in the colours that
# the reader's system likes, also when these change.
_UNPACK = """
const waiting = [];
window.Plotly = {newPlot: (...call) => new Promise(done => waiting.push([call, done]))};
const theme = () => {
  const style = getComputedStyle(document.documentElement);
  const [ink, line, paper] = ['--ink', '--line', '--paper'].map(
    name => style.getPropertyValue(name).trim());
  const none = 'rgba(0,0,0,0)';
  const axis = {color: ink, gridcolor: line, zerolinecolor: line, linecolor: line};
  const side = {...axis, backgroundcolor: none};
  return {layout: {
    paper_bgcolor: none, plot_bgcolor: none, xaxis: axis, yaxis: axis,
    font: {color: ink, family: 'system-ui, sans-serif'}, legend: {bgcolor: none},
    hoverlabel: {bgcolor: paper, font: {color: ink}},
    modebar: {bgcolor: none, color: line, activecolor: ink},
    colorway: ['#d9722e', '#3b82c4', '#3aa655', '#a45cc4', '#d04a4a', '#1a9aa8', '#c99a1f'],
    scene: {xaxis: side, yaxis: side, zaxis: side},
  }};
};
const plotting = (async () => {
  const bytes = Uint8Array.from(atob('PACKED'), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  const script = document.createElement('script');
  script.textContent = await new Response(stream).text();
  document.head.append(script);
  const plot = Plotly.newPlot;
  const draw = (place, traces, layout, options) =>
    plot(place, traces, {...layout, template: theme()}, options);
  Plotly.newPlot = draw;
  for (const [call, done] of waiting) done(draw(...call));
})();
plotting.catch(() => document.body.prepend(
  'The figures need a browser of 2023 or later: Chrome 80, Firefox 113, Safari 16.4.'));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
  for (const place of document.querySelectorAll('.js-plotly-plot'))
    Plotly.relayout(place, {template: theme()});
});
"""


def figure_html(identifier: str, traces: list[dict[str, Any]], layout: dict[str, Any]) -> Html:
    """Return a division and the script that draws traces into it.

    Parameters
    ----------
    identifier : str
        Of the division; letters, digits and hyphens.
    traces, layout
        As the plotting script takes them.
    """
    options = {'responsive': True, 'displaylogo': False}
    arguments = ', '.join(_script(value) for value in (identifier, traces, layout, options))
    return Html(
        f'<div class="figure" id="{identifier}"></div>\n'
        f'<script>plotting.then(() => Plotly.newPlot({arguments}));</script>\n'
    )


def plotting_script() -> Html:
    """Return the plotting library as an inline script, so that the page needs no network.

    Raises
    ------
    ValueError
        If plotly isn't installed.
    """
    # Looked up, not imported: only its JavaScript is needed, and importing takes a while.
    found = importlib.util.find_spec('plotly')
    if found is None or not found.submodule_search_locations:
        raise ValueError('plotly is not installed: install the package again')
    path = Path(found.submodule_search_locations[0]) / 'package_data' / 'plotly.min.js'
    packed = base64.b64encode(_compressed(path)).decode()
    return Html(f'<script>{_UNPACK.replace("PACKED", packed)}</script>\n')


@lru_cache(maxsize=1)
def _compressed(path: Path) -> bytes:
    # A higher level takes half as long again for 0.2 % less.
    return gzip.compress(path.read_bytes(), compresslevel=6, mtime=0)


def plain_text(text: str) -> str:
    """Return a text that the plotting script shows as it is: it reads some HTML tags itself."""
    return text.replace('&', '&amp;').replace('<', '&lt;').replace('>', '&gt;')


def _script(value: object) -> str:
    """Return JSON that may stand inside a script element, whatever strings it holds."""
    text = json.dumps(value, separators=(',', ':'))
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')
