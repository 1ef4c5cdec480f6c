"""Pieces of an HTML page; every text that goes in is escaped."""

import math
from collections.abc import Iterable, Sequence
from html import escape

_STYLE = """
:root { color-scheme: light; --line: #d5d9e0; --ink: #1c2430; --soft: #5b6675; --good: #0b7a3b; }
body { font: 15px/1.5 system-ui, 'Segoe UI', sans-serif; color: var(--ink); margin: 2rem auto;
       max-width: 72rem; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .2rem; } h2 { font-size: 1.25rem; margin-top: 2.2rem; }
p.note { color: var(--soft); max-width: 60rem; }
p.lead { font-size: 1.1rem; max-width: 60rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { padding: .22rem .5rem; border-bottom: 1px solid var(--line); text-align: right;
         white-space: nowrap; }
th { border-bottom: 2px solid var(--line); font-weight: 600; white-space: normal;
     vertical-align: bottom; max-width: 9rem; overflow-wrap: break-word; }
th:first-child, td:first-child, .text { text-align: left; }
td.text { white-space: normal; } tr.best td { color: var(--good); font-weight: 600; }
ul.warnings { border-left: 4px solid #c77700; padding: .5rem 2rem; background: #fff7e8; }
th .role { color: var(--soft); font-weight: 400; }
details { margin: .6rem 0; } summary { cursor: pointer; color: var(--soft); }
.figure { width: 100%; }
"""


class Html(str):
    """Text that is HTML already and isn't escaped again."""


def markup(value: object) -> str:
    """Return a value as HTML: escaped unless it is `Html`."""
    return value if isinstance(value, Html) else escape(str(value))


def paragraph(text: object, kind: str = '') -> Html:
    """Return a paragraph."""
    attribute = f' class="{escape(kind)}"' if kind else ''
    return Html(f'<p{attribute}>{markup(text)}</p>\n')


def section(title: str, *parts: str) -> Html:
    """Return a heading with what belongs to it."""
    return Html(f'<h2>{escape(title)}</h2>\n' + ''.join(markup(part) for part in parts))


def folded(title: str, *parts: str) -> Html:
    """Return parts that the reader opens by a click."""
    body = ''.join(markup(part) for part in parts)
    return Html(f'<details><summary>{escape(title)}</summary>\n{body}</details>\n')


def bullets(items: Iterable[object], kind: str = '') -> Html:
    """Return an unordered list."""
    attribute = f' class="{escape(kind)}"' if kind else ''
    return Html(f'<ul{attribute}>' + ''.join(f'<li>{markup(i)}</li>' for i in items) + '</ul>\n')


def table(
    headings: Sequence[object], rows: Iterable[Sequence[object]], best: Sequence[int] = ()
) -> Html:
    """Return a table.

    Parameters
    ----------
    headings : sequence
    rows : iterable of sequences
        Numbers are shown with four digits, to the right; texts to the left.
    best : sequence of int
        Rows to emphasise.
    """
    rows = list(rows)
    head = ''.join(
        _cell(heading, 'th', as_text=bool(rows) and _is_text(rows[0][column]))
        for column, heading in enumerate(headings)
    )
    body = []
    for index, row in enumerate(rows):
        kind = ' class="best"' if index in best else ''
        body.append(
            f'<tr{kind}>'
            + ''.join(_cell(value, 'td', _is_text(value)) for value in row)
            + '</tr>\n'
        )
    return Html(
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>\n<tbody>\n{"".join(body)}'
        '</tbody></table></div>\n'
    )


def number(value: float | None, digits: int = 4) -> str:
    """Return a number for reading, a dash for None and what isn't finite."""
    if value is None or not math.isfinite(value):
        return '–'
    return f'{value:.{digits}g}'


def page(title: str, head: str, body: Iterable[str]) -> str:
    """Return a complete document; `head` is HTML, such as scripts."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n{head}</head>\n<body>\n'
        f'<h1>{escape(title)}</h1>\n' + ''.join(body) + '</body>\n</html>\n'
    )


def _is_text(value: object) -> bool:
    return isinstance(value, str) and not isinstance(value, Html)


def _cell(value: object, tag: str, as_text: bool) -> str:
    kind = ' class="text"' if as_text else ''
    shown = number(value) if value is None or isinstance(value, float) else markup(value)
    if tag == 'th':
        shown = shown.replace('_', '_<wbr>')  # names of joints and bags may break there
    return f'<{tag}{kind}>{shown}</{tag}>'
