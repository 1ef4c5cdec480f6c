"""The rooms' import rules, read from the syntax trees."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROS_MODULES = {
    *('rclpy', 'sensor_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs', 'geometry_msgs'),
    *('trajectory_msgs', 'rcl_interfaces', 'lifecycle_msgs', 'builtin_interfaces'),
}
# What each room may import from the suite besides itself; imports point one way.
ALLOWED = {
    'description': set(),
    'model': {'description'},
    'control': {'model', 'description'},
    'excitation': {'model', 'description'},
    'identification': {'model', 'description'},
    'simulation': {'model', 'description'},
    'hardware': {'simulation', 'model', 'description'},
    'realtime': set(),
}


def imported_modules(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def python_files(folder: str) -> list[Path]:
    files = sorted((ROOT / folder).rglob('*.py'))
    assert files, f'{folder} is empty'
    return files


@pytest.mark.parametrize('room', sorted(ALLOWED))
def test_pure_rooms_do_not_import_ros(room: str) -> None:
    for path in python_files(f'aerarm_ros/{room}'):
        roots = {name.split('.')[0] for name in imported_modules(path)}
        assert not roots & ROS_MODULES, path
        assert 'aerarm_msgs_py' not in roots, path


@pytest.mark.parametrize('room', sorted(ALLOWED))
def test_imports_point_one_way(room: str) -> None:
    for path in python_files(f'aerarm_ros/{room}'):
        for name in imported_modules(path):
            if name.startswith('aerarm_ros.'):
                other = name.split('.')[1]
                assert other == room or other in ALLOWED[room], f'{path} imports {name}'


def test_the_message_package_stands_alone() -> None:
    for path in python_files('aerarm_msgs_py'):
        assert not any(name.startswith('aerarm_ros') for name in imported_modules(path)), path


def test_no_file_is_too_long_to_read() -> None:
    folders = ('aerarm_ros', 'aerarm_msgs_py', 'test', 'benchmarks')
    for path in [file for folder in folders for file in python_files(folder)]:
        assert len(path.read_text().splitlines()) <= 400, path
