"""Warnings for reading: those that differ in names and numbers only stand together."""

import re
from collections.abc import Iterable, Sequence

from aerarm_ros.pages.html_text import Html, bullets, folded, markup

_NUMBER = re.compile(r'[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')


def grouped_warnings(warnings: Iterable[str], names: Sequence[str]) -> Html:
    """Return a list of warnings, one entry a kind; the others of it are opened by a click.

    Parameters
    ----------
    warnings : iterable of str
    names : sequence of str
        Of joints, links and bags: what may differ within a kind.
    """
    longest_first = sorted((re.escape(name) for name in names if name), key=len, reverse=True)
    name = re.compile('|'.join(longest_first)) if longest_first else None
    kinds: dict[str, list[str]] = {}
    for text in warnings:
        kind = name.sub('@', text) if name else text
        kinds.setdefault(_NUMBER.sub('#', kind), []).append(text)
    items = []
    for texts in kinds.values():
        more = folded(f'{len(texts) - 1} more like it', bullets(texts[1:])) if texts[1:] else ''
        items.append(Html(markup(texts[0]) + more))
    return bullets(items, 'warnings')
