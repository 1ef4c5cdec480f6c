"""Messages quoted in the pages are messages that the programs print."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = 'how-to/faults.md', 'how-to/flight.md', 'faq.md'
COMMANDS = 'arm ', 'ros2 ', 'set ', 'make ', 'pip ', 'NODE: ', '-', 'imu_', 'sudo ', 'encoders: '
# Names, numbers and units, which a program fills in.
FILLED_IN = re.compile(r'\.\.\.|\b(?:joint|board)\d\b|[+-]?\d+(?:\.\d+)?|\{.*?\}')


def texts() -> str:
    """Return all texts in the sources, with a mark where a value is filled in."""
    found = []
    for path in (ROOT / 'aerarm_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else '{}' for p in node.values]
                found.append(''.join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return '\n'.join(' '.join(text.split()) for text in found)


def quoted(page: Path) -> list[str]:
    """Return quotations of several words, without commands."""
    found = re.findall(r'`([^`\n]+)`', page.read_text())
    return [text for text in found if ' ' in text and not text.startswith(COMMANDS)]


@pytest.fixture(scope='module')
def said() -> str:
    return texts()


@pytest.mark.parametrize('page', PAGES)
def test_quoted_messages_exist(page: str, said: str) -> None:
    missing = []
    for text in quoted(ROOT / 'docs' / page):
        pieces = [piece.strip(' ,:') for piece in FILLED_IN.split(text)]
        missing += [f'{text}: {p}' for p in pieces if len(p.split()) > 1 and p not in said]
    assert not missing, '\n'.join(missing)
