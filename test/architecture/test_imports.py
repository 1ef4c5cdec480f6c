"""The rooms' import rules, read from the syntax trees."""

import xml.etree.ElementTree as ElementTree

import pytest
from source_files import ROOT, SUITE, executables, imported_modules, modules_in, python_files

MESSAGE_MODULES = {
    *('builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'lifecycle_msgs', 'nav_msgs'),
    *(
        'mavros_msgs',
        'px4_msgs',
        'rcl_interfaces',
        'rosgraph_msgs',
        'sensor_msgs',
        'std_msgs',
        'std_srvs',
    ),
    *('tf2_msgs', 'trajectory_msgs', 'visualization_msgs'),
}
ROS_MODULES = MESSAGE_MODULES | {'ament_index_python', 'launch', 'launch_ros', 'rclpy'}
# What each room may import from the suite besides itself; imports point one way.
ALLOWED = {
    'description': set(),
    'model': {'description'},
    'motion': set(),
    'pages': set(),
    'control': {'motion', 'model', 'description'},
    'flight': {'control', 'motion', 'model', 'description'},
    'autopilot': {'flight', 'control', 'motion', 'model', 'description'},
    'contact': {'flight', 'control', 'motion', 'model', 'description'},
    'energy': {'control', 'motion', 'model', 'description'},
    'excitation': {'pages', 'motion', 'model', 'description'},
    'identification': {'energy', 'pages', 'model', 'description'},
    'online': {'identification', 'control', 'motion', 'model', 'description'},
    'simulation': {'motion', 'model', 'description'},
    'hardware': {'motion', 'simulation', 'model', 'description'},
    'commissioning': {'hardware', 'simulation', 'model', 'description'},
    'draft': {'excitation', 'hardware', 'motion', 'model', 'description'},
    'experiment': {
        *('control', 'excitation', 'identification', 'hardware', 'simulation'),
        *('pages', 'motion', 'model', 'description'),
    },
    'planner': {'energy', 'excitation', 'control', 'motion', 'model', 'description'},
    'realtime': set(),
}
# What every room may import: it must be said before NumPy is imported.
COMMON = {'algebra_threads'}
# Where ROS is: executables, and what they are made of. They may import every pure room.
ROS_ROOMS = ('nodes', 'ros')


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
                assert other in {room, *ALLOWED[room], *COMMON}, f'{path} imports {name}'


def test_rclpy_is_imported_by_the_ros_rooms_and_messages_only() -> None:
    importers = [
        path.relative_to(ROOT).parts[:2]
        for path in [*python_files('aerarm_ros'), *python_files('aerarm_msgs_py')]
        if 'rclpy' in {name.split('.')[0] for name in imported_modules(path)}
    ]
    rooms = {parts for parts in importers if parts[0] == 'aerarm_ros'}
    assert rooms == {('aerarm_ros', room) for room in ROS_ROOMS}


def test_no_timer_goes_by_the_system_clock() -> None:
    makers = {
        path.stem for path in python_files('aerarm_ros') if '.create_timer(' in path.read_text()
    }
    assert makers == {'steady_timer'}


def test_every_room_has_a_rule() -> None:
    rooms = {path.parent.name for path in (ROOT / 'aerarm_ros').glob('*/__init__.py')}
    assert rooms == {*ALLOWED, *ROS_ROOMS}


def test_nothing_imports_an_executable() -> None:
    # Not one executable from another either; executables.py finds them by name, when one is run.
    for path in [file for folder in SUITE for file in python_files(folder)]:
        for name in imported_modules(path):
            assert not name.startswith('aerarm_ros.nodes'), f'{path} imports {name}'


def test_nodes_holds_the_executables_and_nothing_else() -> None:
    assert modules_in('aerarm_ros/nodes') == sorted(executables())
    assert not list((ROOT / 'aerarm_ros' / 'nodes').glob('*/*.py'))


def test_every_ros_module_is_a_dependency() -> None:
    packages = {
        element.text
        for element in ElementTree.parse(ROOT / 'package.xml').getroot()
        if element.tag.endswith('depend')
    }
    files = [*python_files('aerarm_ros'), *python_files('aerarm_msgs_py'), *python_files('launch')]
    used = {name.split('.')[0] for path in files for name in imported_modules(path)} & ROS_MODULES
    # Messages of autopilots are used where they are installed.
    assert used - {'mavros_msgs', 'px4_msgs'} <= packages


def test_the_message_package_stands_alone() -> None:
    for path in python_files('aerarm_msgs_py'):
        assert not any(name.startswith('aerarm_ros') for name in imported_modules(path)), path


def test_no_file_is_too_long_to_read() -> None:
    folders = ('aerarm_ros', 'aerarm_msgs_py', 'test', 'benchmarks')
    for path in [file for folder in folders for file in python_files(folder)]:
        assert len(path.read_text().splitlines()) <= 400, path
