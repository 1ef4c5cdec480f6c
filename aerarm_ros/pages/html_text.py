"""Pieces of an HTML page; every text that goes in is escaped."""

from __future__ import annotations

import math
import re
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from html import escape
from importlib import metadata
from pathlib import Path

_STYLE = """
:root { color-scheme: light dark; --paper: #fff; --line: #d5d9e0; --ink: #1c2430; --soft: #5b6675;
        --good: #0b7a3b; --warn: #fff7e8; --link: #0b62c4; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #14181e; --line: #39424e; --ink: #e3e7ed; --soft: #9aa5b4; --good: #5fcf8e;
          --warn: #3a2d12; --link: #7db5f5; }
}
body { font: 15px/1.5 system-ui, 'Segoe UI', sans-serif; color: var(--ink);
       background: var(--paper); margin: 2rem auto; max-width: 72rem; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .2rem; } h2 { font-size: 1.25rem; margin-top: 2.2rem; }
a { color: var(--link); }
p.note { color: var(--soft); max-width: 60rem; }
p.lead { font-size: 1.1rem; max-width: 60rem; }
dl.origin { color: var(--soft); display: grid; grid-template-columns: max-content 1fr;
            gap: 0 1rem; margin: .2rem 0 1rem; }
dl.origin dd { margin: 0; overflow-wrap: anywhere; }
nav ul { columns: 16rem; column-gap: 2.5rem; padding-left: 1.2rem; margin: .3rem 0 1rem; }
/* A shadow at the side to which there is more. */
.scroll { overflow-x: auto; background:
  linear-gradient(90deg, var(--paper) 30%, transparent) left / 3rem 100% no-repeat local,
  linear-gradient(270deg, var(--paper) 30%, transparent) right / 3rem 100% no-repeat local,
  linear-gradient(90deg, var(--line), transparent) left / .8rem 100% no-repeat,
  linear-gradient(270deg, var(--line), transparent) right / .8rem 100% no-repeat; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { padding: .22rem .5rem; border-bottom: 1px solid var(--line); text-align: right;
         white-space: nowrap; }
th { border-bottom: 2px solid var(--line); font-weight: 600; white-space: normal;
     vertical-align: bottom; max-width: 9rem; overflow-wrap: break-word; }
th:first-child, td:first-child, .text { text-align: left; }
td.text { white-space: normal; } td.long { min-width: 8rem; }
tr.best td { color: var(--good); font-weight: 600; }
ul.warnings { border-left: 4px solid #c77700; padding: .5rem 2rem; background: var(--warn); }
th .role { color: var(--soft); font-weight: 400; }
details { margin: .6rem 0; } summary { cursor: pointer; color: var(--soft); }
.figure { width: 100%; }
/* The plotting library knows no dark page. */
.updatemenu-item-rect, .updatemenu-header { fill: var(--paper) !important; }
.updatemenu-item-rect { stroke: var(--line) !important; }
.updatemenu-item-text { fill: var(--ink) !important; }
.slider-grip-rect { fill: var(--soft) !important; }
.slider-rail-rect { fill: var(--line) !important; }
@media (max-width: 40em) {
  body { margin: .8rem auto; padding: 0 .8rem; } h1 { font-size: 1.35rem; }
  ul.warnings { padding: .5rem 1.2rem; } .figure { overflow-x: auto; }
}
@media print { nav { display: none; } }
"""
# As wide as a digit, and as a point.
_DIGIT, _POINT = '\N{FIGURE SPACE}', '\N{PUNCTUATION SPACE}'
_LONG = 24  # characters of a text that is not to be one word a line on a phone
_FEW = 3  # sections that need no list of contents
_HEADING = re.compile('<h2>(.*?)</h2>', re.DOTALL)


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
        Numbers are shown with four digits, to the right, point below point; texts to the left.
    best : sequence of int
        Rows to emphasise.
    """
    rows = list(rows)
    shown = list(zip(*map(_aligned, zip(*rows, strict=True)), strict=True))
    head = ''.join(
        _cell(heading, 'th', as_text=bool(rows) and _is_text(rows[0][column]))
        for column, heading in enumerate(headings)
    )
    body = []
    for index, row in enumerate(rows):
        kind = ' class="best"' if index in best else ''
        body.append(
            f'<tr{kind}>'
            + ''.join(
                _cell(text, 'td', _is_text(value))
                for value, text in zip(row, shown[index], strict=True)
            )
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
    titles = _HEADING.findall(text)
    numbers = iter(range(len(titles)))
    text = _HEADING.sub(lambda found: f'<h2 id="s{next(numbers)}">{found[1]}</h2>', text)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n{head}</head>\n<body>\n'
        f'<h1>{escape(title)}</h1>\n{_facts(facts or {})}{_contents(titles)}{text}'
        '</body>\n</html>\n'
    )


def _facts(facts: Mapping[str, str]) -> str:
    rows = ''.join(f'<dt>{escape(k)}</dt><dd>{escape(v)}</dd>' for k, v in facts.items())
    return f'<dl class="origin">{rows}</dl>\n' if rows else ''


def _contents(titles: Sequence[str]) -> str:
    if len(titles) <= _FEW:
        return ''
    items = ''.join(f'<li><a href="#s{k}">{title}</a></li>' for k, title in enumerate(titles))
    return f'<nav><ul>{items}</ul></nav>\n'


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


def _cell(value: object, tag: str, as_text: bool) -> str:
    is_long = as_text and tag == 'td' and len(str(value)) > _LONG
    kind = ' class="text long"' if is_long else ' class="text"' if as_text else ''
    shown = number(value) if value is None or isinstance(value, float) else markup(value)
    if tag == 'th':
        shown = shown.replace('_', '_<wbr>')  # names of joints and bags may break there
    return f'<{tag}{kind}>{shown}</{tag}>'


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
