"""Check of the files, packages and modules that the arguments of a launch file need.

A launch file starts its processes in turn and keeps the first ones running if a later one cannot
start. The bridge would then run alone with enabled motors. So all arguments are checked before any
process starts. This module does not need ROS's launch.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from aerarm_ros.description.config_reader import DescriptionError, check_prefix
from aerarm_ros.description.resources import find_file

# Launch arguments whose value, unless empty, is a file name.
FILES = (
    'params_file',
    'config',
    'urdf',
    'plant_urdf',
    'drone_file',
    'excitation_config',
    'trajectory',
    'identified',
)


# Arguments that also accept the name of a packaged file. `trajectory` and `identified` are results
# of a run, so the package has none.
PACKAGED = ('params_file', 'config', 'urdf', 'plant_urdf', 'drone_file', 'excitation_config')


# ROS packages and Python modules that a value of an argument needs.
_PACKAGES = {('rviz', 'true'): ('rviz2', 'robot_state_publisher')}


_MODULES = {
    ('hardware', 'fake'): 'mujoco',
    ('hardware', 'spi'): 'spidev',
    ('view', 'true'): 'viser',
    ('autopilot', 'px4'): 'px4_msgs',
}


_HOW = {
    'px4_msgs': "build it from PX4's px4_msgs in the same workspace",
    'spidev': "pip install 'spidev>=3.5,<4'",
    'viser': "pip install 'viser>=1.1,<2'",
    'mujoco': 'pip install -r requirements-apt.txt',
}


def missing(arguments: Mapping[str, str], packages: Sequence[str] = ()) -> list[str]:
    """Return a message for each missing file, package or module of the launch arguments.

    Parameters
    ----------
    arguments
        Values of the launch file's arguments, as text.
    packages
        ROS packages that the launch file always needs.
    """
    needed = [('', package) for package in packages]
    needed += [
        (f'{name}:={value}: ', package)
        for (name, value), of_value in _PACKAGES.items()
        for package in of_value
        if arguments.get(name) == value
    ]
    return [
        *_wrong_prefix(arguments),
        *_missing_drone(arguments),
        *_missing_files(arguments),
        *_missing_packages(needed),
        *_missing_modules(arguments),
    ]


def packaged_files(arguments: Mapping[str, str]) -> dict[str, str]:
    """Return the paths of packaged files that launch arguments name, by argument.

    ROS reads the parameter file, and its launch the URDFs, only from a path.
    """
    given = {name: arguments.get(name, '').strip("'") for name in PACKAGED}
    found = {name: str(find_file(path)) for name, path in given.items() if path}
    return {name: path for name, path in found.items() if path != given[name]}


def _wrong_prefix(arguments: Mapping[str, str]) -> Iterator[str]:
    try:
        check_prefix(arguments.get('tf_prefix', ''))
    except DescriptionError as error:
        yield str(error)


def _missing_drone(arguments: Mapping[str, str]) -> Iterator[str]:
    if arguments.get('base_motion') == 'free' and not arguments.get('drone_file', '').strip("'"):
        yield (
            'drone_file is missing: name the drone that carries the arm, for example '
            'drone_file:=config/drone.yaml, or set base_motion:=full on a heavy or ground-driven '
            'base'
        )


def _missing_files(arguments: Mapping[str, str]) -> Iterator[str]:
    packaged = packaged_files(arguments)
    for name in FILES:
        path = packaged.get(name, arguments.get(name, '').strip("'"))
        if path and not os.path.isfile(path):
            yield f'the file {path} of {name} does not exist: check the path'
        elif path and not os.access(path, os.R_OK):
            yield f'the file {path} of {name} is not readable: check its permissions'


def _missing_packages(needed: Sequence[tuple[str, str]]) -> Iterator[str]:
    for what_for, package in needed:
        try:
            get_package_prefix(package)
        except (PackageNotFoundError, OSError):  # OSError: no ROS environment is sourced
            apt = f'ros-jazzy-{package.replace("_", "-")}'
            yield f'{what_for}{package} is not installed: sudo apt install {apt}'


def _missing_modules(arguments: Mapping[str, str]) -> Iterator[str]:
    for (name, value), module in _MODULES.items():
        if arguments.get(name) == value and find_spec(module) is None:
            yield f'{name}:={value} needs the Python package {module}: {_HOW[module]}'
