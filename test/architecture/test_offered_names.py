"""The names that packages offer: they exist, cost nothing until used, and are for users only."""

import importlib
import subprocess
import sys

import pytest
from source_files import (
    ROOT,
    SUITE,
    imported_modules,
    is_package,
    modules_in,
    package_folders,
    python_files,
)

PACKAGES = [folder.replace('/', '.') for folder in package_folders()]
OFFERING = [name for name in PACKAGES if hasattr(importlib.import_module(name), '__all__')]


@pytest.mark.parametrize('package', OFFERING)
def test_every_offered_name_resolves(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None


@pytest.mark.parametrize('package', OFFERING)
def test_no_offered_name_is_that_of_another_module(package: str) -> None:
    # Whether it means the module or what is in it would depend on what was imported first.
    folder = package.replace('.', '/')
    modules = {f'{package}.{name}': name for name in modules_in(folder)}
    module = importlib.import_module(package)
    for full, name in modules.items():
        if name in module.__all__:
            assert getattr(module, name) is importlib.import_module(full)


def test_importing_a_package_imports_none_of_its_modules() -> None:
    script = (
        'import importlib, sys\n'
        'for name in sys.argv[1:]:\n'
        '    importlib.import_module(name)\n'
        "print(*(name for name in sys.modules if name.startswith('aerarm_')))"
    )
    command = [sys.executable, '-c', script, *PACKAGES]
    run = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    # But what has to be said before NumPy is imported.
    assert set(run.stdout.split()) == {*PACKAGES, 'aerarm_ros.realtime.scheduling'}


@pytest.mark.parametrize('folder', [*SUITE, 'launch', 'benchmarks', 'test'])
def test_the_suite_imports_from_modules(folder: str) -> None:
    for path in python_files(folder):
        packages = {name for name in imported_modules(path) if is_package(name)}
        if path.is_relative_to(ROOT / 'test' / 'ros' / 'library'):  # it does what users do
            packages.discard('aerarm_ros')
        assert not packages, f'{path} imports from {packages}: name the module'
