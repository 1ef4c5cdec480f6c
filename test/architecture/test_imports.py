"""Rules of imports and modules, checked by the syntax trees."""

import ast
import re
import xml.etree.ElementTree as ElementTree
from graphlib import TopologicalSorter

from source_files import (
    ROOT,
    SUITE,
    executables,
    imported_modules,
    is_package,
    module_name,
    modules_in,
    python_files,
    syntax_tree,
)

ROS_MODULES = {
    *('ament_index_python', 'launch', 'launch_ros', 'rclpy'),
    *('builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'lifecycle_msgs', 'nav_msgs'),
    *('mavros_msgs', 'px4_msgs', 'rcl_interfaces', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs'),
    *('std_srvs', 'tf2_msgs', 'trajectory_msgs', 'visualization_msgs'),
}
# What each pure package may import from the suite, besides itself and the vocabulary of `motion`:
# imports point one way.
ALLOWED = {
    'description': set(),
    'motion': set(),
    'pages': set(),
    'realtime': set(),
    'model': {'description'},
    'control': {'model', 'description'},
    'flight': {'control', 'model', 'description'},
    'autopilot': {'flight', 'control', 'model', 'description'},
    'energy': {'control', 'model', 'description'},
    'excitation': {'pages', 'model', 'description', 'parallel'},
    'identification': {'energy', 'pages', 'model', 'description'},
    'calibration': {'excitation', 'identification', 'pages', 'model', 'description'},
    'online': {'identification', 'control', 'model', 'description'},
    'simulation': {'model', 'description'},
    'hardware': {'simulation', 'model', 'description'},
    'commissioning': {'hardware', 'simulation', 'model', 'description'},
    'draft': {'excitation', 'hardware', 'model', 'description'},
    'experiment': {
        *('control', 'excitation', 'identification', 'hardware', 'simulation'),
        *('pages', 'model', 'description', 'parallel'),
    },
    'link': set(),
    'planner': {'energy', 'excitation', 'control', 'model', 'description'},
    'world': {'flight', 'control', 'model', 'description'},
}
# Where ROS is: executables, and what they are made of. They may import every pure package.
ROS_PACKAGES = ('nodes', 'ros')
LONGEST, SHORTEST = 600, 21  # lines of a module


def test_pure_packages_import_no_ros_and_point_one_way() -> None:
    packages = {path.parent.name for path in (ROOT / 'aerarm_ros').glob('*/__init__.py')}
    assert packages == {*ALLOWED, *ROS_PACKAGES}
    for package, allowed in ALLOWED.items():
        for path in python_files(f'aerarm_ros/{package}'):
            names = imported_modules(path)
            roots = {name.split('.')[0] for name in names}
            assert not roots & {*ROS_MODULES, 'aerarm_msgs_py'}, path
            others = {name.split('.')[1] for name in names if name.startswith('aerarm_ros.')}
            assert others <= {package, 'motion', *allowed}, path


def test_no_modules_import_each_other() -> None:
    files = python_files(*SUITE)
    graph = {module_name(path): imported_modules(path, at_import=True) for path in files}
    TopologicalSorter(graph).prepare()


def test_rclpy_is_imported_by_the_ros_packages_and_messages_only() -> None:
    importers = [
        path.relative_to(ROOT).parts[:2]
        for path in python_files(*SUITE)
        if 'rclpy' in {name.split('.')[0] for name in imported_modules(path)}
    ]
    packages = {parts for parts in importers if parts[0] == 'aerarm_ros'}
    assert packages == {('aerarm_ros', name) for name in ROS_PACKAGES}


def test_no_timer_goes_by_the_system_clock() -> None:
    files = python_files('aerarm_ros')
    makers = {path.stem for path in files if '.create_timer(' in path.read_text()}
    assert makers == {'executors'}


def test_nothing_imports_an_executable_and_the_message_package_stands_alone() -> None:
    # Not one executable from another either; executables.py finds them by name, when one is run.
    for path in python_files(*SUITE):
        barred = 'aerarm_ros' if 'aerarm_msgs_py' in path.parts else 'aerarm_ros.nodes'
        assert not any(name.startswith(barred) for name in imported_modules(path)), path


def test_the_package_nodes_contains_only_executables() -> None:
    folders = ('aerarm_ros/nodes', 'aerarm_ros/nodes/controllers')
    assert sorted(name for folder in folders for name in modules_in(folder)) == executables()
    for folder in folders:
        for name in modules_in(folder):
            assert re.search(r'\n(def main\(|main = )', (ROOT / folder / f'{name}.py').read_text())


def test_every_ros_module_is_a_dependency() -> None:
    packages = {
        element.text
        for element in ElementTree.parse(ROOT / 'package.xml').getroot()
        if element.tag.endswith('depend')
    }
    files = python_files(*SUITE, 'launch')
    used = {name.split('.')[0] for path in files for name in imported_modules(path)} & ROS_MODULES
    # Messages of autopilots are used where they are installed.
    assert used - {'mavros_msgs', 'px4_msgs'} <= packages


def test_a_module_is_a_concept_neither_a_scrap_nor_a_book() -> None:
    for path in python_files(*SUITE, 'test', 'benchmarks'):
        assert len(path.read_text().splitlines()) <= LONGEST, path
    for path in python_files(*SUITE):
        entry = path.stem == '__init__' or 'nodes' in path.parts
        assert entry or len(path.read_text().splitlines()) >= SHORTEST, path


def test_packages_hold_a_docstring_and_export_nothing() -> None:
    # At the top stand the names for Python users; executables limit NumPy's threads at once.
    for path in python_files(*SUITE):
        if path.stem == '__init__' and path.parent.name not in ('aerarm_ros', 'nodes'):
            (docstring,) = syntax_tree(path).body
            assert isinstance(docstring, ast.Expr), path


def test_the_suite_imports_from_modules() -> None:
    for path in python_files(*SUITE, 'launch', 'benchmarks', 'test'):
        packages = {name for name in imported_modules(path) if is_package(name)}
        if path.is_relative_to(ROOT / 'test'):  # some do what users do
            packages.discard('aerarm_ros')
        assert not packages, f'{path} imports from {packages}: name the module'
