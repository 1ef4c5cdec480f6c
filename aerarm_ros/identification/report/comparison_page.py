"""Two results side by side as a page."""

from typing import Any

from aerarm_ros.identification.files.estimate_comparison import EstimateChange, EstimateComparison
from aerarm_ros.pages.html_text import Html, page, paragraph, section, table
from aerarm_ros.pages.page_origin import origin
from aerarm_ros.pages.plots import figure_html, plain_text, plotting_script

_ROW = 17  # [px]
_NAME = 34  # characters that are shown
_SOME = 60.0  # standard deviations beyond which a bar is cut


def comparison_page(comparison: EstimateComparison, old: str, new: str) -> str:
    """Return a page that opens offline.

    Parameters
    ----------
    comparison : EstimateComparison
    old, new : str
        Names of the two results.

    Raises
    ------
    IdentificationError
        If the plotting script isn't installed.
    """
    clear = [change.name for change in comparison.changes if change.is_clear]
    lead = f'{len(clear)} of {len(comparison.changes)} differ by more than three of their '
    lead += f'standard deviations{": " if clear else ""}{", ".join(clear)}.'
    parts = [paragraph(lead, 'lead')]
    for title, changes in (
        ('Friction', comparison.friction),
        ('Inertia', comparison.inertia),
        ('Drives', comparison.drives),
    ):
        if changes:
            identifier = title.lower()
            parts.append(section(title, _figure(changes, identifier), _table(changes, old, new)))
    if comparison.unmatched:
        parts.append(
            paragraph(
                f'{comparison.unmatched} sums of parameters are determined by one of the two '
                'motions only.',
                'note',
            )
        )
    return page(f'{new} against {old}', plotting_script(), parts, origin())


def _table(changes: tuple[EstimateChange, ...], old: str, new: str) -> Html:
    rows = [
        [c.name, Html(c.unit), c.old, c.new, c.new - c.old, c.std, c.deviations] for c in changes
    ]
    headings = ['', 'unit', old, new, 'difference', 'standard deviation', 'in deviations']
    return table(headings, rows, [i for i, change in enumerate(changes) if change.is_clear])


def _figure(changes: tuple[EstimateChange, ...], identifier: str) -> Html:
    """Return bars: differences in standard deviations."""
    names = [c.name if len(c.name) <= _NAME else c.name[: _NAME - 1] + '…' for c in changes]
    trace: dict[str, Any] = {
        'type': 'bar',
        'orientation': 'h',
        'x': [round(max(-_SOME, min(_SOME, c.deviations)), 3) for c in changes],
        'y': [plain_text(name) for name in names],
        'marker': {'color': ['#b3261e' if c.is_clear else '#a9bdd6' for c in changes]},
    }
    layout = {
        'height': _ROW * len(changes) + 90,
        'margin': {'l': 260, 'r': 15, 't': 10, 'b': 45},
        'template': 'none',
        'xaxis': {'title': {'text': 'difference, in its standard deviations'}},
        'yaxis': {'autorange': 'reversed', 'tickfont': {'size': 11}, 'type': 'category'},
    }
    return figure_html(identifier, [trace], layout)
