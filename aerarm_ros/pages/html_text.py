"""Elements of an HTML page, from the templates in `elements.html`, and tables as text."""

from __future__ import annotations

import math
import re
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

Html = Markup
"""Type of a text that is already HTML; templates do not escape such texts."""

# Spaces as wide as a digit, and as a decimal point.
_DIGIT, _POINT = '\N{FIGURE SPACE}', '\N{PUNCTUATION SPACE}'
_LONG = 24  # number of characters above which a text may wrap on a narrow screen
_FEW = 3  # largest number of sections without a table of contents
_HEADING = re.compile('<h2>(.*?)</h2>', re.DOTALL)


_FOLDER = Path(__file__).parent


@cache
def macros(path: Path) -> Any:
    """Return the macros of an HTML template. A macro returns `Html` and escapes its arguments."""
    # Imported here, because the import takes 0.1 s and most programs write no page.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(path.parent),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(path.name).module


def _elements() -> Any:
    return macros(_FOLDER / 'elements.html')


def paragraph(text: object, kind: str = '') -> Html:
    """Return a text as an HTML paragraph of the CSS class `kind`."""
    return Html(_elements().paragraph(text, kind))


def section(title: str, *parts: str) -> Html:
    """Return a section of an HTML report: a heading, followed by the section's content."""
    return Html(_elements().section(title, parts))


def folded(title: str, *parts: str) -> Html:
    """Return an HTML element whose parts are hidden until the reader clicks on its title."""
    return Html(_elements().folded(title, parts))


def bullets(items: Iterable[object], kind: str = '') -> Html:
    """Return an unordered HTML list of the CSS class `kind`."""
    return Html(_elements().bullets(items, kind))


def markup(value: object) -> Html:
    """Convert a value to HTML: escape its text unless its type is `Html`."""
    return Html(escape(value))


def table(
    headings: Sequence[object], rows: Iterable[Sequence[object]], best: Sequence[int] = ()
) -> Html:
    """Return an HTML table whose first row contains the headings.

    Parameters
    ----------
    headings : sequence
        Column headings.
    rows : iterable of sequences
        Cells. Numbers have four digits and are aligned at the decimal point; texts are
        left-aligned.
    best : sequence of int
        Indices of the rows to emphasize.
    """
    rows = list(rows)
    first = rows[0] if rows else [None] * len(headings)
    # Allow line breaks in headings with names of joints and bags.
    head = [
        (markup(heading).replace('_', Html('_<wbr>')), 'text' if _is_text(value) else '')
        for heading, value in zip(headings, first, strict=False)
    ]
    body = zip(*map(_cells, zip(*rows, strict=True)), strict=True)
    return Html(_elements().table(head, list(body), best))


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of a table as text for a terminal; only the first column is left-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        '  '.join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows
    )
    return '\n'.join(line.rstrip() for line in lines)


def number(value: float | None, digits: int = 4) -> str:
    """Convert a number to text; None and non-finite values become a dash."""
    if value is None or not math.isfinite(value):
        return '–'
    return f'{value:.{digits}g}'


def page(title: str, head: str, body: Iterable[str], facts: Mapping[str, str] | None = None) -> str:
    """Return a complete HTML document.

    Parameters
    ----------
    title
        Title of the page.
    head
        HTML for the head element, for example scripts.
    body
        Content. Headings of `section` appear in the table of contents.
    facts
        Names and values to show at the top of the page, for example date and command line.
    """
    text = ''.join(body)
    titles = [Html(title) for title in _HEADING.findall(text)]
    numbers = iter(range(len(titles)))
    text = _HEADING.sub(lambda found: f'<h2 id="s{next(numbers)}">{found[1]}</h2>', text)
    style = (_FOLDER / 'page.css').read_text(encoding='utf-8')
    contents = titles if len(titles) > _FEW else ()
    document = _elements().page(title, Html(style), Html(head), facts, contents, Html(text))
    return str(document)


def _cells(column: Sequence[object]) -> list[tuple[Html, str]]:
    """Return text and CSS class of the cells of a column; the decimal points of numbers align."""
    texts = [number(x) if x is None or isinstance(x, float) else None for x in column]
    tails = [len(x.partition('.')[2]) for x in texts if x and '.' in x and 'e' not in x]
    longest = max(tails, default=0)
    return [
        (markup(value), _kind(value)) if text is None else (_filled(text, longest), '')
        for value, text in zip(column, texts, strict=True)
    ]


def _filled(text: str, digits: int) -> Html:
    if not digits or not text[-1].isdigit() or 'e' in text:
        return Html(text)
    point = '' if '.' in text else _POINT
    return Html(text + point + _DIGIT * (digits - len(text.partition('.')[2])))


def _is_text(value: object) -> bool:
    return isinstance(value, str) and not isinstance(value, Html)


def _kind(value: object) -> str:
    if not _is_text(value):
        return ''
    return 'text long' if len(str(value)) > _LONG else 'text'


_PACKAGE = 'aerarm_ros'


def package_version() -> str:
    """Return the version of the installed package, or 'not installed'."""
    try:
        return metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        return 'not installed'


def origin(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Return date, version and command line of the program that writes a report."""
    program, *rest = sys.argv if arguments is None else arguments
    return {
        'made': f'{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}',
        'by': f'{_PACKAGE} {package_version()}',
        'command': shlex.join([Path(program).name, *rest]),
    }
