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

# Launch arguments that name a packaged file or another file; an empty value names none.
PACKAGED = ('params_file', 'config', 'urdf', 'plant_urdf', 'drone_file', 'excitation_config')
# Launch arguments that name a file. The package contains no results of a run.
FILES = (*PACKAGED, 'trajectory', 'identified')
# ROS packages that RViz needs.
_RVIZ = ('rviz2', 'robot_state_publisher')
# Python module that a value of a launch argument requires, and how to install it.
_MODULES = {
    ('hardware', 'fake'): ('mujoco', 'pip install -r requirements-apt.txt'),
    ('hardware', 'spi'): ('spidev', "pip install 'spidev>=3.5,<4'"),
    ('view', 'true'): ('viser', "pip install 'viser>=1.1,<2'"),
    ('autopilot', 'px4'): (
        'px4_msgs',
        'build the repository px4_msgs of PX4 in the same workspace',
    ),
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
    return list(_missing(arguments, packages))


def _missing(arguments: Mapping[str, str], packages: Sequence[str]) -> Iterator[str]:
    try:
        check_prefix(arguments.get('tf_prefix', ''))
    except DescriptionError as error:
        yield str(error)
    if arguments.get('base_motion') == 'free' and not _path(arguments, 'drone_file'):
        yield (
            'base_motion:=free needs a drone file: pass drone_file:=config/drone.yaml or another '
            'file, or set base_motion:=full for a heavy base or a ground vehicle'
        )
    packaged = packaged_files(arguments)
    for name in FILES:
        path = packaged.get(name) or _path(arguments, name)
        if path and not os.path.isfile(path):
            yield f'the file {path} (argument {name}) does not exist: check the path'
        elif path and not os.access(path, os.R_OK):
            yield f'the file {path} (argument {name}) is not readable: check its permissions'
    needed = [('this launch file needs', package) for package in packages]
    if arguments.get('rviz') == 'true':
        needed += [('rviz:=true needs', package) for package in _RVIZ]
    for what_for, package in needed:
        try:
            get_package_prefix(package)
        except (PackageNotFoundError, OSError):  # OSError: no ROS environment is sourced
            apt = f'ros-jazzy-{package.replace("_", "-")}'
            yield (
                f'{what_for} the ROS package {package}, which is not installed: sudo apt install '
                f'{apt}'
            )
    for (name, value), (module, how) in _MODULES.items():
        if arguments.get(name) == value and find_spec(module) is None:
            yield f'the launch argument {name}:={value} needs the Python package {module}: {how}'


def _path(arguments: Mapping[str, str], name: str) -> str:
    """Return the path in a launch argument; launch writes an empty value in quotes."""
    return arguments.get(name, '').strip("'")


def packaged_files(arguments: Mapping[str, str]) -> dict[str, str]:
    """Return the path of each packaged file that a launch argument names, by argument name.

    ROS needs a path to the parameter file, and launch needs paths to the URDFs.
    """
    given = {name: _path(arguments, name) for name in PACKAGED}
    found = {name: str(find_file(path)) for name, path in given.items() if path}
    return {name: path for name, path in found.items() if path != given[name]}
