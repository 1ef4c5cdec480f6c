"""The suite's source files, and what they import, read from their syntax trees."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SUITE = ('aerarm_ros', 'aerarm_msgs_py')


def python_files(folder: str) -> list[Path]:
    """Return the Python files of a folder and of all below it; there must be some."""
    files = sorted((ROOT / folder).rglob('*.py'))
    assert files, f'{folder} is empty'
    return files


def package_folders() -> list[str]:
    """Return the folders of the suite's packages, inner ones too, as 'aerarm_ros/model'."""
    files = [path for package in SUITE for path in python_files(package)]
    return [str(path.parent.relative_to(ROOT)) for path in files if path.name == '__init__.py']


def modules_in(folder: str) -> list[str]:
    """Return the names of the modules in a package's own folder."""
    return sorted(path.stem for path in (ROOT / folder).glob('*.py') if path.stem != '__init__')


def rooms_offered_by(folder: str) -> tuple[str, ...]:
    """Return the rooms inside a room, in the order of `submodules` in its `__init__.py`."""
    tree = ast.parse((ROOT / folder / '__init__.py').read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == 'submodules':
            names: list[str] = ast.literal_eval(node.value)
            return tuple(name for name in names if (ROOT / folder / name).is_dir())
    raise ValueError(f'{folder} offers no rooms')


def executables() -> list[str]:
    """Return the names in the list EXECUTABLES of setup.py."""
    return listed_in_setup('EXECUTABLES')


def listed_in_setup(name: str) -> list[str]:
    """Return a list of texts of setup.py."""
    for statement in ast.parse((ROOT / 'setup.py').read_text()).body:
        if isinstance(statement, ast.Assign):
            (target,) = statement.targets
            if isinstance(target, ast.Name) and target.id == name:
                return list(ast.literal_eval(statement.value))
    raise ValueError(f'setup.py has no list {name}')


@cache
def imported_modules(path: Path) -> frozenset[str]:
    """Return the full names of the modules that a file imports.

    `from a.b import c` imports `a.b.c` if that is a module or package of the suite, else `a.b`.
    """
    return frozenset(_imported(ast.parse(path.read_text()), path))


def _imported(tree: ast.AST, path: Path) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, f'{path}: rules are read from full names'
            for alias in node.names:
                below = f'{node.module}.{alias.name}'
                yield below if is_package(below) or _is_module(below) else node.module


@cache
def is_package(name: str) -> bool:
    """Tell whether a dotted name is that of one of the suite's packages."""
    return (ROOT / name.replace('.', '/') / '__init__.py').is_file()


@cache
def _is_module(name: str) -> bool:
    return (ROOT / f'{name.replace(".", "/")}.py').is_file()
