"""Columns of tables: detection of joints, markers, poses, contacts and units."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.calibration.tables import PostureTable, read_postures

JOINTS = ('base_joint', 'elbow')


def table(tmp_path: Path, header: str, *rows: str, **options: object) -> PostureTable:
    path = tmp_path / 'postures.csv'
    path.write_text('\n'.join([header, *rows]) + '\n')
    return read_postures(path, JOINTS, **options)  # type: ignore[arg-type]


def test_joints_by_name_and_numbered_markers(tmp_path: Path) -> None:
    found = table(tmp_path, 'x1,y1,z1,x2,y2,z2,elbow,base_joint,t_start_robot',
                  '1,2,3,4,5,6,0.5,-1,99')  # fmt: skip
    assert found.joints['elbow'][0] == 0.5 and found.joints['base_joint'][0] == -1.0
    assert found.measured['marker2'].position.tolist() == [[4.0, 5.0, 6.0]]
    assert found.unused == ['t_start_robot']
    assert 'marker marker1: columns x1, y1, z1 [m]' in found.mapping


def test_numbered_joints_are_those_of_the_urdf_in_turn(tmp_path: Path) -> None:
    found = table(tmp_path, 'q2,q1 [deg],x1,y1,z1', '0.2,90,1,2,3')
    assert found.joints['base_joint'][0] == pytest.approx(np.pi / 2)
    assert found.joints['elbow'][0] == 0.2
    assert not found.unused


def test_units_of_columns_and_default_units(tmp_path: Path) -> None:
    found = table(tmp_path, 'tip.x [mm],tip.y [mm],tip.z [mm],q_elbow [degrees],base_joint',
                  '1000,0,-500,90,0')  # fmt: skip
    np.testing.assert_allclose(found.measured['tip'].position[0], [1.0, 0.0, -0.5])
    assert found.joints['elbow'][0] == pytest.approx(np.pi / 2)
    header, rows = 'x1,y1,z1,elbow,base_joint', ('1,2,3,90,180', ',,,90,180')
    found = table(tmp_path, header, *rows, length_unit='mm', degrees=True)
    measured = [[1e-3, 2e-3, 3e-3], [np.nan] * 3]  # an empty cell: not seen
    np.testing.assert_allclose(found.measured['marker1'].position, measured)
    assert found.joints['base_joint'][0] == pytest.approx(np.pi)


def test_quaternions_and_angles_make_poses(tmp_path: Path) -> None:
    found = table(tmp_path, 'x1,y1,z1,qx1,qy1,qz1,qw1,x2,y2,z2,phix2,phiy2,phiz2,elbow',
                  '0,0,1,0,0,0.70710678,0.70710678,0,0,1,0,0,1.5707963,0.1')  # fmt: skip
    for name in ('marker1', 'marker2'):
        rotation = found.measured[name].rotation
        assert rotation is not None
        np.testing.assert_allclose(rotation[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-7)


@pytest.mark.parametrize(
    ('header', 'row', 'expected'),
    [
        ('x1,y1,z1,wrist', '1,2,3,4', 'is a joint of the URDF (base_joint, elbow)'),
        ('elbow,base_joint', '1,2', 'name marker columns x1, y1, z1 [m]'),
        ('x1,y1,z1,x2,y2,elbow', '1,2,3,4,5,6', 'has no z, only x2, y2'),
        ('x1,y1,z1,x1,elbow', '1,2,3,4,5', 'has two columns with the name x1'),
        ('tip.x [mm],tip.y,tip.z,elbow', '1,2,3,4', 'tip.x [mm], tip.y, tip.z of'),
        ('x1,y1,z1,roll1 [deg],pitch1,yaw1,elbow', '1,2,3,4,5,6,7', 'different units'),
        ('x1,y1,z1,elbow [turns]', '1,2,3,4', 'unknown unit turns'),
        ('x1,y1,z1,elbow', '1,2,3', 'has 3 values, but there are 4 columns'),
        ('x1,y1,z1,elbow', '1,2,o3,4', "column z1: 'o3' in line 2 is not a number"),
        ('1,2,3,4', '1,2,3,4', 'must name the columns'),
        ('x1,y1,z1,elbow,q_elbow', '1,2,3,4,5', 'has two columns of joint elbow'),
    ],
)
def test_an_unreadable_table_raises_one_error(
    tmp_path: Path, header: str, row: str, expected: str
) -> None:
    with pytest.raises(CalibrationError) as error:
        table(tmp_path, header, row)
    assert expected in str(error.value) and '\n' not in str(error.value)


def test_missing_files_and_samples_of_a_motion_are_rejected(tmp_path: Path) -> None:
    def rows(interval: float) -> list[str]:
        return [f'{interval * k},{0.001 * k},1,2,3' for k in range(300)]

    with pytest.raises(CalibrationError, match='check the path'):
        read_postures(tmp_path / 'none.csv', JOINTS)
    with pytest.raises(CalibrationError, match='records a motion'):
        table(tmp_path, 'time [s],elbow,x1,y1,z1', *rows(0.01))
    assert len(table(tmp_path, 'time [s],elbow,x1,y1,z1', *rows(2.0)).joints['elbow']) == 300
