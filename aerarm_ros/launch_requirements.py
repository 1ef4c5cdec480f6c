"""Find missing files, packages and modules that launch arguments require.

If a process of a launch file cannot start, the processes before it keep running. The bridge would
then run alone, with the motors switched on. Therefore this module checks all arguments before any
process starts. The module does not import ROS's launch.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from aerarm_ros.description.config_reader import DescriptionError, check_prefix
from aerarm_ros.description.resources import find_file

# Launch arguments that name a file; an empty value names none.
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


# Launch arguments that also accept the name of a packaged file. The package contains no file for
# `trajectory` and `identified`, which are results of a run.
PACKAGED = ('params_file', 'config', 'urdf', 'plant_urdf', 'drone_file', 'excitation_config')


# ROS packages and Python modules that a value of a launch argument requires.
_PACKAGES = {('rviz', 'true'): ('rviz2', 'robot_state_publisher')}


_MODULES = {
    ('hardware', 'fake'): 'mujoco',
    ('hardware', 'spi'): 'spidev',
    ('view', 'true'): 'viser',
    ('autopilot', 'px4'): 'px4_msgs',
}


_HOW = {
    'px4_msgs': 'build the repository px4_msgs of PX4 in the same workspace',
    'spidev': "pip install 'spidev>=3.5,<4'",
    'viser': "pip install 'viser>=1.1,<2'",
    'mujoco': 'pip install -r requirements-apt.txt',
}


def missing(arguments: Mapping[str, str], packages: Sequence[str] = ()) -> list[str]:
    """Return one message for each missing file, package or module.

    Parameters
    ----------
    arguments
        Values of the launch arguments, as text.
    packages
        ROS packages that the launch file needs for all arguments.
    """
    needed = [('this launch file needs', package) for package in packages]
    needed += [
        (f'{name}:={value} needs', package)
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
    """Return the path of each packaged file that a launch argument names, by argument name.

    ROS needs a path to the parameter file, and launch needs paths to the URDFs.
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
            'base_motion:=free needs a drone file: pass drone_file:=config/drone.yaml or another '
            'file, or set base_motion:=full for a heavy base or a ground vehicle'
        )


def _missing_files(arguments: Mapping[str, str]) -> Iterator[str]:
    packaged = packaged_files(arguments)
    for name in FILES:
        path = packaged.get(name, arguments.get(name, '').strip("'"))
        if path and not os.path.isfile(path):
            yield f'the file {path} (argument {name}) does not exist: check the path'
        elif path and not os.access(path, os.R_OK):
            yield f'the file {path} (argument {name}) is not readable: check its permissions'


def _missing_packages(needed: Sequence[tuple[str, str]]) -> Iterator[str]:
    for what_for, package in needed:
        try:
            get_package_prefix(package)
        except (PackageNotFoundError, OSError):  # OSError: no ROS environment is sourced
            apt = f'ros-jazzy-{package.replace("_", "-")}'
            yield (
                f'{what_for} the ROS package {package}, which is not installed: sudo apt install '
                f'{apt}'
            )


def _missing_modules(arguments: Mapping[str, str]) -> Iterator[str]:
    for (name, value), module in _MODULES.items():
        if arguments.get(name) == value and find_spec(module) is None:
            yield (
                f'the launch argument {name}:={value} needs the Python package {module}: '
                f'{_HOW[module]}'
            )
