"""The suite's source files and their imports, from their syntax trees."""

import ast
import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
SUITE = ('aerarm_ros', 'aerarm_msgs_py')


def python_files(*folders: str) -> list[Path]:
    """Return the Python files of directories, searched recursively; each must have some."""
    files = []
    for folder in folders:
        found = sorted((ROOT / folder).rglob('*.py'))
        assert found, f'{folder} is empty'
        files += found
    return files


def module_name(path: Path) -> str:
    """Return the dotted name of a module or package."""
    parts = path.relative_to(ROOT).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def modules_in(folder: str) -> list[str]:
    """Return the names of the modules in a package's own directory."""
    return sorted(path.stem for path in (ROOT / folder).glob('*.py') if path.stem != '__init__')


def executables() -> list[str]:
    """Return the names of the commands."""
    return sorted(path.stem for path in (ROOT / 'aerarm_ros' / 'nodes').rglob('[a-z]*.py'))


def listed_in_setup(name: str) -> list[str]:
    """Return a list of texts in setup.py."""
    for statement in ast.parse((ROOT / 'setup.py').read_text()).body:
        if isinstance(statement, ast.Assign):
            (target,) = statement.targets
            if isinstance(target, ast.Name) and target.id == name:
                return list(ast.literal_eval(statement.value))
    raise ValueError(f'setup.py has no list {name}')


@cache
def parameter_page() -> ModuleType:
    """Return the program that writes the page of parameters, as a module."""
    path = ROOT / 'docs' / 'generate_parameters.py'
    spec = importlib.util.spec_from_file_location('generate_parameters', path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def syntax_tree(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text())


@cache
def imported_modules(path: Path, at_import: bool = False) -> frozenset[str]:
    """Return the full names of a file's imports, or only of those executed at import.

    `from a.b import c` imports `a.b.c` if that is a module or package of the suite, else `a.b`.
    """
    body = syntax_tree(path).body
    return frozenset(_imported(body if at_import else statements(body), path))


def statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield statements and all statements inside them."""
    for statement in body:
        yield statement
        for part in ('body', 'orelse', 'finalbody', 'handlers', 'cases'):
            yield from statements(getattr(statement, part, []))


def _imported(nodes: Iterator[ast.stmt] | list[ast.stmt], path: Path) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, f'{path}: rules are read from full names'
            for alias in node.names:
                below = f'{node.module}.{alias.name}'
                yield below if is_package(below) or _is_module(below) else node.module


@cache
def is_package(name: str) -> bool:
    """Return whether a dotted name is one of the suite's packages."""
    return (ROOT / name.replace('.', '/') / '__init__.py').is_file()


@cache
def _is_module(name: str) -> bool:
    return (ROOT / f'{name.replace(".", "/")}.py').is_file()
