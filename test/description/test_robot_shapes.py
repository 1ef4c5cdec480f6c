import os
import struct
import time
from pathlib import Path

import pinocchio as pin
import pytest

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.robot import load_robot
from aerarm_ros.description.robot_shapes import load_shapes
from aerarm_ros.excitation.clearance import build_collision_geometry
from aerarm_ros.excitation.settings import ExcitationError

TRIANGLES = [((0, 0, 0), (0, 0, 1), (0, 1, 0)), ((0, 0, 0), (0, 0, 1), (1, 0, 0))]


def stl(triangles=TRIANGLES) -> bytes:
    rows = [struct.pack('<12fH', 0, 0, 1, *(x for p in t for x in p), 0) for t in triangles]
    return bytes(80) + struct.pack('<I', len(rows)) + b''.join(rows)


def arm(folder: Path, *meshes: str):
    shapes = ''.join(
        f'<collision><geometry><mesh filename="{mesh}"/></geometry></collision>' for mesh in meshes
    )
    path = folder / 'arm.urdf'
    path.write_text(
        '<robot name="r"><link name="base"/><link name="link"><inertial><mass value="1"/>'
        f'<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="link"/></joint>'
        '</robot>'
    )
    return load_robot(path)


@pytest.mark.parametrize('name', ['part.stl', 'package://robot/part.stl', 'file://{}/part.stl'])
def test_a_mesh_is_found_and_read(tmp_path, name):
    (tmp_path / 'robot').mkdir()
    for folder in (tmp_path, tmp_path / 'robot'):
        (folder / 'part.stl').write_bytes(stl())
    shapes = load_shapes(arm(tmp_path, name.format(tmp_path)), pin.GeometryType.COLLISION)
    assert shapes.geometryObjects[0].geometry.num_vertices >= 4


def test_a_missing_or_damaged_mesh_is_not_called_too_large(tmp_path):
    (tmp_path / 'part.stl').write_bytes(stl()[:100])
    for name in ('part.stl', 'none.stl'):
        with pytest.raises((ValueError, RuntimeError)) as error:
            load_shapes(arm(tmp_path, name), pin.GeometryType.COLLISION)
        assert not isinstance(error.value, DescriptionError)


def endless(folder: Path) -> list[str]:
    (folder / 'part.stl').symlink_to('/dev/zero')
    return ['part.stl', f'file://{folder}/part.stl', 'package://part.stl']


def waiting(folder: Path) -> list[str]:
    os.mkfifo(folder / 'part.stl')
    return ['part.stl']


def large(folder: Path) -> list[str]:
    with (folder / 'part.stl').open('wb') as file:
        file.truncate(9 * 2**20)
    return ['part.stl']


def large_together(folder: Path) -> list[str]:
    with (folder / 'part.stl').open('wb') as file:
        file.truncate(7 * 2**20)
    return ['part.stl'] * 5


def compressed(folder: Path) -> list[str]:
    (folder / 'part.3mf').write_bytes(b'PK')
    return ['part.3mf']


def showing_one_another(folder: Path) -> list[str]:
    # Each shows the one before twice: 2^40 of the last.
    nodes = ''.join(
        f'<node id="n{k}"><instance_node url="#n{k - 1}"/><instance_node url="#n{k - 1}"/></node>'
        for k in range(1, 40)
    )
    text = f'<COLLADA><library_nodes>{nodes}</library_nodes></COLLADA>'
    (folder / 'part.dae').write_text(text)
    return ['part.dae']


@pytest.mark.parametrize(
    ('make', 'reason'),
    [
        (endless, 'part.stl is not a regular file'),
        (waiting, 'part.stl is not a regular file'),
        (large, 'part.stl has 9 MiB, above the limit of 8 MiB: simplify it$'),
        (large_together, 'have 35 MiB in total, above the limit of 32 MiB'),
        (lambda folder: ['none.stl'] * 1001, 'refers to 1001 meshes, above the limit of 1000'),
        (compressed, r'part.3mf has an unsupported format: convert it to one of \.dae, \.obj'),
        (showing_one_another, 'repeats its parts too often'),
    ],
)
def test_dangerous_meshes_are_refused_at_once(tmp_path, make, reason):
    meshes, start = make(tmp_path), time.process_time()
    for names in (meshes, meshes[:1]) if make is endless else (meshes,):
        with pytest.raises(DescriptionError, match=reason):
            load_shapes(arm(tmp_path, *names), pin.GeometryType.COLLISION)
    assert time.process_time() - start < 1.0
    with pytest.raises(ExcitationError, match=reason):  # as the designer reports it
        build_collision_geometry(arm(tmp_path, *meshes), None)
