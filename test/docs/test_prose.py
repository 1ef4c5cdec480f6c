"""The prose check: user texts follow the vocabulary and have short sentences."""

from __future__ import annotations

from pathlib import Path

import pytest
from prose import counts, exceptions, findings


def test_findings_only_shrink() -> None:
    found, listed = counts(), exceptions()
    more = {name: count for name, count in found.items() if count > listed.get(name, 0)}
    assert not more, f'python test/docs/prose.py FILE names the findings of {more}'
    fewer = [name for name, count in listed.items() if count > found.get(name, 0)]
    assert not fewer, f'shorten the list, python test/docs/prose.py --record: {fewer}'


@pytest.mark.parametrize(
    ('name', 'text', 'count'),
    [
        ('page.md', 'The node is told of it.\n\n```\nthe node is told of it\n```\n', 1),
        ('page.md', 'One value a joint, beside `one a joint`.', 2),
        ('page.md', f'{"word " * 26}.\n\n{"word " * 25}.', 1),
        ('page.md', f'| {"word " * 20} | {"word " * 20} |', 0),
        ('code.py', f'"""Return it."""\nraise ValueError(f"the {{x}} leans: {"so " * 26}")', 2),
        ('code.py', '"""Return what was heard.\n\nIt was heard.\n"""\nkey = "tare"', 1),
        ('page.html', '<p class="lean">{{ heard }} The <b>believed</b> angle</p>', 1),
        ('page.js', "label.textContent = 'hand-over';  /* tare */", 1),
    ],
)
def test_findings_are_counted(name: str, text: str, count: int, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert len(findings(path)) == count, findings(path)
