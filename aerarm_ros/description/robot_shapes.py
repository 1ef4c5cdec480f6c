"""Visual and collision shapes of a robot, with size limits for mesh files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.robot import Robot

_MIB = 2**20
# A mesh of 8 MiB is read and made convex in 10 s with 700 MB. The largest mesh of published arms
# has 5 MiB, and the largest total of one arm is 21 MiB.
_LARGEST = 8 * _MIB
_LARGEST_TOGETHER = 32 * _MIB
_MOST = 1000
# Mesh formats without compression or references, so the file size bounds the content, ...
_FORMATS = ('.dae', '.obj', '.ply', '.stl')
# ... except for nodes of a Collada file that instantiate another node.
_INSTANCE, _INSTANCE_OF_NODE = b'<instance_', b'<instance_node'
_MOST_INSTANCES, _MOST_INSTANCES_OF_NODES = 2000, 16


def load_shapes(
    robot: Robot, kind: pin.GeometryType, package_directories: Sequence[Path] = ()
) -> pin.GeometryModel:
    """Return the visual or collision shapes of a robot's links.

    Parameters
    ----------
    robot
        Robot model of the arm.
    kind
        Visual or collision shapes.
    package_directories
        Folders for `package://` meshes, in addition to the folders above the URDF.

    Raises
    ------
    DescriptionError
        If a mesh is not a regular file of a known format, or is too large.
    ValueError, RuntimeError
        If a mesh is missing or damaged.
    """
    folders = list(package_directories)
    if robot.path is not None:
        folders += Path(robot.path).resolve().parents
    _check_meshes(robot.urdf_text, folders)
    return pin.buildGeomFromUrdfString(
        robot.model, robot.urdf_text, kind, package_dirs=[str(folder) for folder in folders]
    )


def _check_meshes(urdf: str, folders: Sequence[Path]) -> None:
    """Check the size and format of all mesh files in a URDF before loading the first one."""
    names = [mesh.get('filename', '') for mesh in ET.fromstring(urdf).iter('mesh')]
    if len(names) > _MOST:
        raise DescriptionError(
            f'the URDF refers to {len(names)} meshes, above the limit of {_MOST}: use fewer meshes'
        )
    together = 0
    for name in names:
        path = name.partition('://')[2] if '://' in name else name
        for file in (Path(path), *(folder / path.lstrip('/') for folder in folders)):
            if path and file.exists():
                together += _checked_size(file)
                break
    if together > _LARGEST_TOGETHER:
        raise DescriptionError(
            f'the meshes of the URDF have {together / _MIB:.0f} MiB in total, above the limit of '
            f'{_LARGEST_TOGETHER // _MIB} MiB: simplify them'
        )


def _checked_size(file: Path) -> int:
    """Return the size of a mesh file in bytes; raise an error for an unsuitable file."""
    if not file.is_file():
        raise DescriptionError(f'mesh {file} is not a regular file: check its path')
    if file.suffix.lower() not in _FORMATS:
        raise DescriptionError(
            f'mesh {file} has an unsupported format: convert it to one of {", ".join(_FORMATS)}'
        )
    size = file.stat().st_size
    if size > _LARGEST:
        raise DescriptionError(
            f'mesh {file} has {size / _MIB:.0f} MiB, above the limit of {_LARGEST // _MIB} MiB: '
            'simplify it'
        )
    if file.suffix.lower() == '.dae':
        text = file.read_bytes()
        of_nodes = text.count(_INSTANCE_OF_NODE)
        if of_nodes > _MOST_INSTANCES_OF_NODES or text.count(_INSTANCE) > _MOST_INSTANCES:
            raise DescriptionError(
                f'mesh {file} repeats its parts too often (<instance_...>): replace the '
                'references by the parts, or simplify the mesh'
            )
    return size
