"""Checks of the launch files without ROS's launch: all started executables exist."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml
from source_files import imported_modules, parameter_page, python_files

from aerarm_ros.executables import command_modules, controllers

ROOT = Path(__file__).resolve().parents[2]
LAUNCH_FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
PARTS = ROOT / 'aerarm_ros' / 'launch_parts.py'
DRIVE_IT = ROOT / 'docs' / 'how-to' / 'drive_it.md'
ONLY_BRINGUP = ('computed_torque.launch', 'gravity_compensation.launch')
PARAMETER_FILES = sorted((ROOT / 'config').glob('parameters_*.yaml'))


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
    names |= {literal(call.args[0]) for call in calls(path, 'node')}
    if 'controllers()' in path.read_text():
        names |= set(controllers())
    return {name for name in names if isinstance(name, str)}


def declared(path: Path) -> set[str]:
    names = {literal(call.args[0]) for call in calls(path, 'DeclareLaunchArgument')}
    names |= {literal(call.args[0]) for call in calls(path, 'switch_argument')}
    return {name for name in names if isinstance(name, str)}


def given(call: ast.Call) -> set[str]:
    """Return the parameters that a call of `node` sets by itself."""
    if len(call.args) < 2:
        return set()
    names = {
        literal(key)
        for part in ast.walk(call.args[1])
        if isinstance(part, ast.Dict)
        for key in part.keys
        if key
    }
    for part in ast.walk(call.args[1]):
        if isinstance(part, ast.Call) and getattr(part.func, 'id', '') == 'arguments_as_parameters':
            names |= {literal(argument) for argument in part.args}
        if isinstance(part, ast.Call) and getattr(part.func, 'id', '') == 'arm_parameters':
            names |= {'config', 'urdf', 'tf_prefix', *(literal(name) for name in part.args)}
    return {str(name) for name in names}


def used(path: Path) -> set[str]:
    return {
        str(literal(call.args[0]))
        for call in calls(path, 'LaunchConfiguration')
        if isinstance(call.args[0], ast.Constant)
    }


def test_every_executable_is_installed_and_every_configuration_declared() -> None:
    for path in [*LAUNCH_FILES, PARTS]:
        assert started(path) <= set(command_modules()), path
    shared = declared(ROOT / 'launch' / 'bringup.launch.py') | declared(PARTS)
    for path in LAUNCH_FILES:
        assert used(path) <= declared(path) | shared, path


def test_shared_arguments_are_described() -> None:
    assert {'controller', 'base_motion', 'enable', 'excitation_config'} <= declared(PARTS)
    for path in (PARTS, *LAUNCH_FILES):
        for name in declared(path):
            assert f'`{name}`' in DRIVE_IT.read_text(), (path, name)


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_each_launch_file_is_documented_and_has_the_arguments_of_bringup(path: Path) -> None:
    text = path.read_text()
    assert ast.get_docstring(ast.parse(text))
    # Requirements are checked before any process starts.
    assert calls(path, 'check_first') or path.stem in ONLY_BRINGUP
    assert f'ros2 launch aerarm_ros {path.name}' in text
    assert f'`{path.name}`' in DRIVE_IT.read_text()
    if path.name == 'bringup.launch.py':
        wanted = {'hardware', 'namespace', 'params_file', 'urdf', 'plant_urdf', 'rviz', 'view'}
        assert wanted <= declared(path)
    elif path.name not in ('experiment.launch.py', 'ground_side.launch.py'):  # without a bridge
        assert 'bringup.launch.py' in text
        assert calls(path, 'bringup')


@pytest.mark.parametrize(('side', 'other'), [('drone', 'ground'), ('ground', 'drone')])
def test_each_side_takes_the_address_of_the_other(side: str, other: str) -> None:
    path = ROOT / 'launch' / f'{side}_side.launch.py'
    (link,) = (call for call in calls(path, 'node') if literal(call.args[0]) == 'ground_link')
    assert other in declared(path)
    assert {'role', other} <= given(link)
    guide = (ROOT / 'docs' / 'how-to' / 'two_computers.md').read_text()
    assert f'{path.name} ' in guide
    assert f' {other}:=192.168.1.' in next(
        line for line in guide.splitlines() if f'ros2 launch aerarm_ros {path.name}' in line
    )


@pytest.mark.parametrize('path', PARAMETER_FILES, ids=lambda path: path.name)
def test_parameter_files_contain_only_parameters_of_the_nodes(
    path: Path, ros_domain: dict[str, str]
) -> None:
    content = yaml.safe_load(path.read_text())
    assert content
    for pattern, entry in content.items():
        name = pattern.removeprefix('/**/')
        assert name in command_modules()
        table = {parameter.name: parameter for parameter in parameter_page().parameters_of(name)}
        for key, value in entry['ros__parameters'].items():
            assert table[key].problem(table[key].adapt(value)) is None


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_nodes_get_the_files_of_the_arm_and_only_parameters_that_they_have(
    path: Path, ros_domain: dict[str, str]
) -> None:
    for call in calls(path, 'node'):
        executable = literal(call.args[0])
        if executable is None:  # bringup's bridge and controller, known when it is launched
            continue
        table = {parameter.name for parameter in parameter_page().parameters_of(str(executable))}
        assert given(call) <= table
        assert given(call) >= table & {
            *('config', 'urdf', 'tf_prefix', 'excitation_config', 'base_motion')
        }


def test_only_launch_files_need_ros_launch() -> None:
    importers = {
        path
        for path in python_files('aerarm_ros', 'aerarm_msgs_py', 'launch')
        if {name.split('.')[-1] for name in imported_modules(path)} & {'launch', 'launch_parts'}
    }
    assert importers == {*LAUNCH_FILES, PARTS}
