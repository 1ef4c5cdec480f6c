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


def endless(path: Path) -> str:
    path.symlink_to('/dev/zero')
    return 'is not a regular file'


def waiting(path: Path) -> str:
    os.mkfifo(path)
    return 'is not a regular file'


def large(path: Path) -> str:
    with path.open('wb') as file:
        file.truncate(9 * 2**20)
    return 'has 9 MiB, above the limit of 8 MiB: simplify it$'


@pytest.mark.parametrize('make', [endless, waiting, large])
def test_no_mesh_is_read_that_has_no_end_or_is_too_large(tmp_path, make):
    reason = make(tmp_path / 'part.stl')
    start = time.process_time()
    for name in ('part.stl', f'file://{tmp_path}/part.stl', 'package://part.stl'):
        with pytest.raises(DescriptionError, match=f'part.stl {reason}'):
            load_shapes(arm(tmp_path, name), pin.GeometryType.COLLISION)
    assert time.process_time() - start < 1.0


def test_meshes_are_bounded_together_and_in_number(tmp_path):
    with (tmp_path / 'part.stl').open('wb') as file:
        file.truncate(7 * 2**20)
    with pytest.raises(DescriptionError, match='have 35 MiB in total, above the limit of 32 MiB'):
        load_shapes(arm(tmp_path, *['part.stl'] * 5), pin.GeometryType.COLLISION)
    with pytest.raises(DescriptionError, match='refers to 1001 meshes, above the limit of 1000'):
        load_shapes(arm(tmp_path, *['none.stl'] * 1001), pin.GeometryType.COLLISION)


def test_a_format_that_may_be_compressed_is_refused(tmp_path):
    (tmp_path / 'part.3mf').write_bytes(b'PK')
    with pytest.raises(
        DescriptionError,
        match=(
            r'part.3mf has an unsupported format: convert it to one of \.dae, \.obj, \.ply, \.stl'
        ),
    ):
        load_shapes(arm(tmp_path, 'part.3mf'), pin.GeometryType.COLLISION)


def test_parts_that_show_one_another_are_refused(tmp_path):
    # Each shows the one before twice: 2^40 of the last.
    nodes = ''.join(
        f'<node id="n{k}"><instance_node url="#n{k - 1}"/><instance_node url="#n{k - 1}"/></node>'
        for k in range(1, 40)
    )
    (tmp_path / 'part.dae').write_text(f'<COLLADA><library_nodes>{nodes}</library_nodes></COLLADA>')
    with pytest.raises(DescriptionError, match='repeats its parts too often'):
        load_shapes(arm(tmp_path, 'part.dae'), pin.GeometryType.COLLISION)


def test_the_designer_reports_the_reason(tmp_path):
    reason = large(tmp_path / 'part.stl')
    with pytest.raises(ExcitationError, match=reason):
        build_collision_geometry(arm(tmp_path, 'part.stl'), None)
