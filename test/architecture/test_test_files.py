"""Requirements of launch_testing's pytest plugin, which imports all test files by path."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

TEST = Path(__file__).resolve().parents[1]
FILES = sorted(path for path in TEST.rglob('*.py') if path.name != 'conftest.py')
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def at_module_level(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run when a module is imported."""
    for child in ast.iter_child_nodes(node):
        yield child
        if isinstance(child, FUNCTIONS):
            continue
        yield from at_module_level(child)


def module_level_skips(source: str) -> list[int]:
    """Return the lines that skip a whole module."""
    return [
        node.lineno
        for node in at_module_level(ast.parse(source))
        if isinstance(node, (ast.Name, ast.Attribute))
        and (node.attr if isinstance(node, ast.Attribute) else node.id)
        in ('importorskip', 'SkipTest', 'Skipped')
        or isinstance(node, ast.keyword)
        and node.arg == 'allow_module_level'
    ]


def test_basenames_are_unique() -> None:
    # It would take one file for the other and stop.
    counts = Counter(path.name for path in FILES)
    assert [name for name, count in counts.items() if count > 1] == []


def test_no_file_skips_itself_when_it_is_imported() -> None:
    # It would skip all tests of the session: a mark skips those of the file.
    for path in FILES:
        assert module_level_skips(path.read_text()) == [], path


@pytest.mark.parametrize(
    ('source', 'is_found'),
    [
        ("viser = pytest.importorskip('viser')", True),
        ("if find_spec('viser') is None:\n    pytest.skip('why', allow_module_level=True)", True),
        ("try:\n    import viser\nexcept ImportError:\n    raise unittest.SkipTest('why')", True),
        ("def test_it():\n    pytest.importorskip('viser')", False),
    ],
)
def test_module_level_skips_are_found(source: str, is_found: bool) -> None:
    assert bool(module_level_skips(source)) == is_found
