"""What a room offers by name without importing it."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LAZY_ROOMS = [
    '.'.join(path.parent.relative_to(ROOT).parts)
    for path in sorted((ROOT / 'aerarm_ros').rglob('__init__.py'))
    if 'lazy_loader' in path.read_text()
]


@pytest.mark.parametrize('room', LAZY_ROOMS)
def test_every_name_is_there(room: str) -> None:
    package = importlib.import_module(room)
    assert package.__doc__
    for name in package.__all__:
        assert getattr(package, name).__name__.split('.')[-1] == name or name == 'FloatArray'


def test_the_suite_itself_imports_from_the_modules() -> None:
    for path in (ROOT / 'aerarm_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.module not in LAZY_ROOMS, f'{path}: {node.module}'
