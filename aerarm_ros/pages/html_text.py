"""Elements of an HTML page, made by the templates in `elements.html`."""

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
"""Text that is HTML already and isn't escaped again."""

# As wide as a digit, and as a point.
_DIGIT, _POINT = '\N{FIGURE SPACE}', '\N{PUNCTUATION SPACE}'
_LONG = 24  # characters of a text that is not to be one word a line on a phone
_FEW = 3  # sections that need no list of contents
_HEADING = re.compile('<h2>(.*?)</h2>', re.DOTALL)


_FOLDER = Path(__file__).parent


@cache
def macros(path: Path) -> Any:
    """Return the macros of a template; each returns `Html`, in which texts are escaped."""
    # It takes 0.1 s, which no program without a page has to wait for.
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
    """Return a paragraph."""
    return Html(_elements().paragraph(text, kind))


def section(title: str, *parts: str) -> Html:
    """Return a heading with what belongs to it."""
    return Html(_elements().section(title, parts))


def folded(title: str, *parts: str) -> Html:
    """Return parts that the reader opens by a click."""
    return Html(_elements().folded(title, parts))


def bullets(items: Iterable[object], kind: str = '') -> Html:
    """Return an unordered list."""
    return Html(_elements().bullets(items, kind))


def markup(value: object) -> Html:
    """Return a value as HTML: escaped unless it is `Html`."""
    return Html(escape(value))


def table(
    headings: Sequence[object], rows: Iterable[Sequence[object]], best: Sequence[int] = ()
) -> Html:
    """Return a table.

    Parameters
    ----------
    headings : sequence
    rows : iterable of sequences
        Numbers are shown with four digits, to the right, point below point; texts to the left.
    best : sequence of int
        Rows to emphasise.
    """
    rows = list(rows)
    shown = zip(*map(_aligned, zip(*rows, strict=True)), strict=True)
    first = rows[0] if rows else [None] * len(headings)
    # Names of joints and bags may break in a heading.
    head = [
        (markup(heading).replace('_', Html('_<wbr>')), 'text' if _is_text(value) else '')
        for heading, value in zip(headings, first, strict=False)
    ]
    body = [
        [(_shown(text), _kind(value)) for value, text in zip(row, texts, strict=True)]
        for row, texts in zip(rows, shown, strict=True)
    ]
    return Html(_elements().table(head, body, best))


def number(value: float | None, digits: int = 4) -> str:
    """Return a number for reading, a dash for None and what isn't finite."""
    if value is None or not math.isfinite(value):
        return '–'
    return f'{value:.{digits}g}'


def page(title: str, head: str, body: Iterable[str], facts: Mapping[str, str] | None = None) -> str:
    """Return a complete document.

    Parameters
    ----------
    title
        Of the page.
    head
        HTML, such as scripts.
    body
        What it shows; what `section` made is in the list of contents.
    facts
        What stands at the top, by name, such as when and how it was made.
    """
    text = ''.join(body)
    titles = [Html(title) for title in _HEADING.findall(text)]
    numbers = iter(range(len(titles)))
    text = _HEADING.sub(lambda found: f'<h2 id="s{next(numbers)}">{found[1]}</h2>', text)
    style = (_FOLDER / 'page.css').read_text(encoding='utf-8')
    contents = titles if len(titles) > _FEW else ()
    document = _elements().page(title, Html(style), Html(head), facts, contents, Html(text))
    return str(document)


def _aligned(column: Sequence[object]) -> list[object]:
    """Return a column's cells, its numbers filled up so that their points lie below each other."""
    texts = [number(x) if x is None or isinstance(x, float) else None for x in column]
    tails = [len(x.partition('.')[2]) for x in texts if x and '.' in x and 'e' not in x]
    longest = max(tails, default=0)
    return [
        value if text is None else _filled(text, longest)
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


def _shown(value: object) -> str:
    return number(value) if value is None or isinstance(value, float) else markup(value)


_PACKAGE = 'aerarm_ros'


def origin(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Return date, version and command line of this run; of `arguments`, by default its own."""
    program, *rest = sys.argv if arguments is None else arguments
    try:
        version = metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        version = 'not installed'
    return {
        'made': f'{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}',
        'by': f'{_PACKAGE} {version}',
        'command': shlex.join([Path(program).name, *rest]),
    }
