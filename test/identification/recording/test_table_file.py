"""Tables are read as bags are, and what they lack is said."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.table_file import TableOptions, read_table

JOINTS = ('shoulder_pan', 'elbow')
T = np.arange(0.0, 1.0, 0.01)
Q = np.column_stack([np.sin(T), np.cos(T)])
DQ = np.column_stack([np.cos(T), -np.sin(T)])
TAU = np.column_stack([T, 2.0 * T])


def csv(path: Path, header: str, *columns: np.ndarray, delimiter: str = ',') -> Path:
    np.savetxt(path, np.column_stack(columns), header=header, comments='', delimiter=delimiter)
    return path


@pytest.mark.parametrize(
    ('header', 'delimiter'),
    [
        ('time,q_shoulder_pan,q_elbow,dq_shoulder_pan,dq_elbow,tau_shoulder_pan,tau_elbow', ','),
        ('"t";q1;q2;dq1;dq2;tau1;tau2', ';'),
        ('Time\tq[0]\tq[1]\tqd[0]\tqd[1]\ttorque[0]\ttorque[1]', '\t'),
        (
            'stamp, shoulder_pan.position [rad], elbow.position [rad], shoulder_pan.velocity, '
            'elbow.velocity, shoulder_pan.effort (Nm), elbow.effort (Nm)',
            ',',
        ),
        ('timestamp,actual_q_0,actual_q_1,actual_qd_0,actual_qd_1,eff_0,eff_1', ','),
        ('t,q_0,q_1,dq_0,dq_1,i0 [A],i1 [A]', ','),
        ('t,q(1),q(2),dq(1),dq(2),i_1 [A],i_2 [A]', ','),
        (
            '__time,/joint_states/shoulder_pan/position,/joint_states/elbow/position,'
            '/joint_states/velocity[0],/joint_states/velocity[1],/arm/effort[0],/arm/effort[1]',
            ',',
        ),
    ],
)
def test_columns_are_known_by_their_names(tmp_path: Path, header: str, delimiter: str) -> None:
    path = csv(tmp_path / 'a.csv', header, T, Q, DQ, TAU, delimiter=delimiter)
    states = read_table(path, JOINTS)
    assert states.names == JOINTS
    for found, true in (
        (states.stamp, T),
        (states.position, Q),
        (states.velocity, DQ),
        (states.effort, TAU),
    ):
        np.testing.assert_allclose(found, true, atol=1e-15)


def test_the_columns_show_from_where_they_are_numbered(tmp_path: Path) -> None:
    aside = np.zeros_like(T)
    for first in (0, 1):
        numbers = range(first, first + 2)
        header = ','.join(['time', *(f'{word}{k}' for word in ('q', 'tau') for k in numbers)])
        states = read_table(csv(tmp_path / 'a.csv', header, T, Q, TAU), JOINTS)
        np.testing.assert_array_equal(states.position, Q)
        assert (
            states.columns
            == f'shoulder_pan: q{first} tau{first}, elbow: q{first + 1} tau{first + 1}'
        )
    # Three columns for two joints: the first or the last one is of no joint.
    path = csv(tmp_path / 'a.csv', 'time,q0,q1,q2,tau0,tau1,tau2', T, Q, aside, TAU, aside)
    with pytest.raises(
        IdentificationError, match=r'q0, q1, q2.* begin at 0 or at 1 for 2 .*--numb'
    ):
        read_table(path, JOINTS)
    states = read_table(path, JOINTS, TableOptions(numbered_from=0))
    np.testing.assert_array_equal(states.effort, TAU)


@pytest.mark.parametrize(('unit', 'degrees'), [('', True), (' [deg]', False)])
def test_degrees_become_radians(tmp_path: Path, unit: str, degrees: bool) -> None:
    header = f'time,q1{unit},q2{unit},dq1{unit},dq2{unit},tau1,tau2'
    path = csv(tmp_path / 'a.csv', header, T, np.degrees(Q), np.degrees(DQ), TAU)
    states = read_table(path, JOINTS, TableOptions(degrees=degrees))
    np.testing.assert_allclose(states.position, Q)
    np.testing.assert_allclose(states.velocity, DQ)
    np.testing.assert_allclose(states.effort, TAU)


def test_stated_units_are_used(tmp_path: Path) -> None:
    header = 'time [ms],q1 [mrad],q2 (°),dq1 [rpm],dq2 [degrees/s],tau1 [mNm],tau2 [N m]'
    scaled = (1e3 * T, 1e3 * Q[:, 0], np.degrees(Q[:, 1]), 30.0 / np.pi * DQ[:, 0])
    columns = (*scaled, np.degrees(DQ[:, 1]), 1e3 * TAU[:, 0], TAU[:, 1])
    path = csv(tmp_path / 'a.csv', header, *columns)
    # Of a column that states its unit --degrees says nothing.
    for options in (TableOptions(), TableOptions(degrees=True)):
        states = read_table(path, JOINTS, options)
        np.testing.assert_allclose(states.stamp, T, atol=1e-15)
        np.testing.assert_allclose(states.position, Q, atol=1e-15)
        np.testing.assert_allclose(states.velocity, DQ, atol=1e-15)
        np.testing.assert_allclose(states.effort, TAU, atol=1e-15)


def test_currents_are_efforts_where_there_are_no_others(tmp_path: Path) -> None:
    header = 'time,q1,q2,current1 [mA],current2 [A],tau1'
    path = csv(tmp_path / 'a.csv', header, T, Q, 1e3 * TAU[:, 1], TAU[:, 1], TAU[:, 0])
    states = read_table(path, JOINTS)
    order = [states.names.index(name) for name in JOINTS]
    np.testing.assert_allclose(states.effort[:, order], TAU)
    np.savez(tmp_path / 'a.npz', time=T, q=Q, current=TAU)
    np.testing.assert_array_equal(read_table(tmp_path / 'a.npz', JOINTS).effort, TAU)


def test_arrays_that_state_the_unit_of_their_angles(tmp_path: Path) -> None:
    arrays = {'time': T, 'q': np.degrees(Q), 'dq': np.degrees(DQ), 'tau': TAU}
    np.savez(tmp_path / 'a.npz', **arrays, unit='deg')
    states = read_table(tmp_path / 'a.npz', JOINTS)
    np.testing.assert_allclose(states.position, Q)
    np.testing.assert_allclose(states.velocity, DQ)
    np.testing.assert_array_equal(states.effort, TAU)
    np.savez(tmp_path / 'a.npz', **arrays, unit='gon')
    with pytest.raises(IdentificationError, match=r'q \(array unit\) has the unknown unit gon'):
        read_table(tmp_path / 'a.npz', JOINTS)


@pytest.mark.parametrize('names', [None, ('elbow', 'shoulder_pan')])
def test_arrays(tmp_path: Path, names: tuple[str, str] | None) -> None:
    more = {} if names is None else {'joint_names': np.array(names)}
    np.savez(tmp_path / 'a.npz', time=T, q=Q, velocity=DQ, torques=TAU, other=np.eye(7), **more)
    states = read_table(tmp_path / 'a.npz', JOINTS)
    assert states.names == (names or JOINTS)
    np.testing.assert_array_equal(states.position, Q)
    np.testing.assert_array_equal(states.velocity, DQ)
    np.testing.assert_array_equal(states.effort, TAU)


@pytest.mark.parametrize(
    ('header', 'columns', 'words'),
    [
        ('q1,q2,tau1,tau2', (Q, TAU), 'no time column: .*--rate'),
        ('time,q1,q2,tau1', (T, Q, T), 'no effort of elbow .*: name the column tau_elbow'),
        ('time,a,b', (T, Q), 'no position of any joint'),
        ('a,b', (T, T), r'its columns are a, b\): name the columns time: time/times'),
        ('0.0,1.0,2.0', (T, Q), 'must name the columns'),
        ('time,q1,q2', (T, Q, TAU), '3 names, but there are 5 columns'),
        (
            'time,q1,q[0],tau1,tau2',
            (T, Q, TAU),
            r'q1 and q\[0\] of .* both contain the position of shoulder',
        ),
        (
            'time,t,q1,tau1',
            (T, T, Q[:, 0], T),
            'time and t of .* both contain the time: remove one',
        ),
        ('time,q1,q2,tau1 [lbf],tau2', (T, Q, TAU), r'column tau1 .*unknown unit lbf'),
    ],
)
def test_an_invalid_table_raises_an_error_with_the_reason(
    tmp_path: Path, header: str, columns, words: str
) -> None:
    path = csv(tmp_path / 'a.csv', header, *columns)
    with pytest.raises(IdentificationError, match=words):
        read_table(path, JOINTS)


def test_unreadable_tables_raise_errors(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match='check the path'):
        read_table(tmp_path / 'none.csv', JOINTS)
    for name, content in (('a.csv', b'time,q1\n1.0,two\n'), ('a.npz', b'PK nothing')):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(IdentificationError, match='is not a table of numbers'):
            read_table(path, JOINTS)
    np.savez(tmp_path / 'b.npz', time=T, q=Q[:, :1], tau=TAU)
    with pytest.raises(
        IdentificationError, match=r'q has the shape \(100, 1\) instead of \(M, 2\)'
    ):
        read_table(tmp_path / 'b.npz', JOINTS)
    np.savez(tmp_path / 'c.npz', time=T[:50], q=Q, tau=TAU)
    with pytest.raises(IdentificationError, match='differ in length'):
        read_table(tmp_path / 'c.npz', JOINTS)
    np.savez(tmp_path / 'e.npz', time=T, q=Q, position=Q, tau=TAU)
    with pytest.raises(
        IdentificationError, match='arrays position and q of .* contain the same quantity'
    ):
        read_table(tmp_path / 'e.npz', JOINTS)
    np.savez(tmp_path / 'd.npz', time=T, q=np.array([{}], dtype=object), tau=TAU)
    with pytest.raises(IdentificationError, match='is not a table of numbers'):
        read_table(tmp_path / 'd.npz', JOINTS)
    with pytest.raises(IdentificationError, match='--rate 0 must be'):
        TableOptions(rate=0.0)
