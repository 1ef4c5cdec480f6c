"""What the arguments of a launch file need: files, packages and modules.

A launch file starts its processes one after the other, and does not stop the first ones where a
later one cannot start: the bridge would go on alone, with the motors on. So all arguments are
checked before anything starts. This module needs no ROS launch.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from aerarm_ros.description.config_reader import DescriptionError, check_prefix
from aerarm_ros.description.resources import find_file

# Launch arguments that name a file, where they name anything.
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


# Those of them that may name a packaged file; `trajectory` and `identified` are results of a run.
PACKAGED = ('params_file', 'config', 'urdf', 'plant_urdf', 'drone_file', 'excitation_config')


# Argument and value: what that needs of ROS, and of Python.
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
    """Return what a launch file's arguments need and is not there, with what to do.

    Parameters
    ----------
    arguments
        Values of the launch file's arguments, as text.
    packages
        Of ROS, that it needs whatever its arguments.
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
    """Return the paths of the packaged files that arguments give by name, by argument.

    ROS's launch reads the URDFs, and ROS the parameter file, from a path only.
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
        except (PackageNotFoundError, OSError):  # OSError: no environment is sourced
            apt = f'ros-jazzy-{package.replace("_", "-")}'
            yield f'{what_for}{package} is not installed: sudo apt install {apt}'


def _missing_modules(arguments: Mapping[str, str]) -> Iterator[str]:
    for (name, value), module in _MODULES.items():
        if arguments.get(name) == value and find_spec(module) is None:
            yield f'{name}:={value} needs the Python package {module}: {_HOW[module]}'
