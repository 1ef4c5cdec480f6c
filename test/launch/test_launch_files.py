"""What can be said about the launch files without ROS's launch: they start what there is."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
LAUNCH_FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
DRIVE_IT = ROOT / 'docs' / 'how-to' / 'drive_it.md'
PARAMETER_FILES = sorted((ROOT / 'config').glob('parameters_*.yaml'))


@pytest.fixture(scope='module')
def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        'generate_parameters', ROOT / 'docs' / 'generate_parameters.py'
    )
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def keywords(call: ast.Call) -> dict[str, ast.expr]:
    return {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}


def calls(path: Path, *names: str) -> list[ast.Call]:
    """Return the calls of functions by these names in a file."""
    return [
        node
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') in names
    ]


def literal(node: ast.expr | None) -> object:
    return node.value if isinstance(node, ast.Constant) else None


def started(path: Path) -> set[str]:
    """Return the executables of this package that a launch file names."""
    names = {
        literal(keywords(call).get('executable'))
        for call in calls(path, 'Node', 'ExecutableInPackage')
        if literal(keywords(call).get('package')) == 'aerarm_ros'
    }
    names |= {literal(call.args[0]) for call in calls(path, '_node')}
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'CONTROLLERS':
            names |= set(ast.literal_eval(node.value))
    return {name for name in names if isinstance(name, str)}


def declared(path: Path) -> set[str]:
    return {str(literal(call.args[0])) for call in calls(path, 'DeclareLaunchArgument')}


def used(path: Path) -> set[str]:
    return {
        str(literal(call.args[0]))
        for call in calls(path, 'LaunchConfiguration')
        if isinstance(call.args[0], ast.Constant)
    }


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_every_executable_is_installed(path: Path, reference: ModuleType) -> None:
    assert started(path) <= set(reference.executables())


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_every_configuration_is_declared(path: Path) -> None:
    arguments = declared(path) | declared(ROOT / 'launch' / 'bringup.launch.py')
    assert used(path) <= arguments


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_it_is_documented_and_takes_the_arguments_of_bringup(path: Path) -> None:
    text = path.read_text()
    assert ast.get_docstring(ast.parse(text))
    assert f'ros2 launch aerarm_ros {path.name}' in text
    assert f'`{path.name}`' in DRIVE_IT.read_text()
    if path.name == 'bringup.launch.py':
        wanted = {'hardware', 'controller', 'namespace', 'params_file', 'rviz', 'view', 'enable'}
        assert wanted <= declared(path)
    elif path.name != 'experiment.launch.py':  # which needs no bridge
        assert 'bringup.launch.py' in text


@pytest.mark.parametrize('path', PARAMETER_FILES, ids=lambda path: path.name)
def test_parameter_files_hold_what_the_nodes_have(
    path: Path, reference: ModuleType, ros_domain: dict[str, str]
) -> None:
    content = yaml.safe_load(path.read_text())
    assert content
    for pattern, entry in content.items():
        name = pattern.removeprefix('/**/')
        assert name in reference.executables()
        table = {parameter.name: parameter for parameter in reference.parameters_of(name)}
        for key, value in entry['ros__parameters'].items():
            assert table[key].problem(table[key].adapt(value)) is None


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_parameters_set_in_launch_files_exist(
    path: Path, reference: ModuleType, ros_domain: dict[str, str]
) -> None:
    for call in calls(path, '_node'):
        table = {p.name for p in reference.parameters_of(str(literal(call.args[0])))}
        assert isinstance(call.args[1], ast.Dict)
        assert {str(literal(key)) for key in call.args[1].keys if key} <= table
