"""Tables are read as bags are, and what they lack is said."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.table_file import TableOptions, TableStates, read_table

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
    check(states)


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


def check(states: TableStates) -> None:
    found = (states.stamp, states.position, states.velocity, states.effort)
    for values, true in zip(found, (T, Q, DQ, TAU), strict=True):
        np.testing.assert_allclose(values, true, atol=1e-15)


@pytest.mark.parametrize('degrees', [True, False])
def test_units_become_si(tmp_path: Path, degrees: bool) -> None:
    """Of a column or an array that states its unit, --degrees says nothing."""
    unit = '' if degrees else ' [deg]'
    path, options = tmp_path / 'a.csv', TableOptions(degrees=degrees)
    header = f'time,q1{unit},q2{unit},dq1{unit},dq2{unit},tau1,tau2'
    check(read_table(csv(path, header, T, np.degrees(Q), np.degrees(DQ), TAU), JOINTS, options))
    header = 'time [ms],q1 [mrad],q2 (°),dq1 [rpm],dq2 [degrees/s],tau1 [mNm],tau2 [N m]'
    scaled = (1e3 * T, 1e3 * Q[:, 0], np.degrees(Q[:, 1]), 30.0 / np.pi * DQ[:, 0])
    columns = (*scaled, np.degrees(DQ[:, 1]), 1e3 * TAU[:, 0], TAU[:, 1])
    check(read_table(csv(path, header, *columns), JOINTS, options))
    arrays = {'time': T, 'q': np.degrees(Q), 'dq': np.degrees(DQ), 'tau': TAU}
    np.savez(tmp_path / 'a.npz', **arrays, unit='deg')
    check(read_table(tmp_path / 'a.npz', JOINTS, options))
    np.savez(tmp_path / 'a.npz', **arrays, unit='gon')
    with pytest.raises(IdentificationError, match=r'q \(array unit\) has the unknown unit gon'):
        read_table(tmp_path / 'a.npz', JOINTS)


def test_currents_are_efforts_where_there_are_no_others(tmp_path: Path) -> None:
    header = 'time,q1,q2,current1 [mA],current2 [A],tau1'
    path = csv(tmp_path / 'a.csv', header, T, Q, 1e3 * TAU[:, 1], TAU[:, 1], TAU[:, 0])
    states = read_table(path, JOINTS)
    order = [states.names.index(name) for name in JOINTS]
    np.testing.assert_allclose(states.effort[:, order], TAU)
    np.savez(tmp_path / 'a.npz', time=T, q=Q, current=TAU)
    np.testing.assert_array_equal(read_table(tmp_path / 'a.npz', JOINTS).effort, TAU)


@pytest.mark.parametrize('names', [None, ('elbow', 'shoulder_pan')])
def test_arrays(tmp_path: Path, names: tuple[str, str] | None) -> None:
    more = {} if names is None else {'joint_names': np.array(names)}
    np.savez(tmp_path / 'a.npz', time=T, q=Q, velocity=DQ, torques=TAU, other=np.eye(7), **more)
    states = read_table(tmp_path / 'a.npz', JOINTS)
    assert states.names == (names or JOINTS)
    check(states)


@pytest.mark.parametrize(
    ('header', 'columns', 'words'),
    [
        ('q1,q2,tau1,tau2', (Q, TAU), 'no time column: .*--rate'),
        ('time,q1,q2,tau1', (T, Q, T), 'no effort of elbow .*: name the column tau_elbow'),
        ('time,a,b', (T, Q), 'no position of any joint'),
        ('a,b', (T, T), r'its columns are a, b\): name the columns time: time/times'),
        ('0.0,1.0,2.0', (T, Q), 'must name the columns'),
        ('time,q1,q2', (T, Q, TAU), '3 names, but there are 5 columns'),
        ('time,q1,q[0],tau1,tau2', (T, Q, TAU), r'q1 and q\[0\] of .* both contain the position'),
        ('time,t,q1,tau1', (T, T, Q[:, 0], T), 'time and t of .* both contain the time: remove'),
        ('time,q1,q2,tau1 [lbf],tau2', (T, Q, TAU), r'column tau1 .*unknown unit lbf'),
    ],
)
def test_an_invalid_table_raises_an_error_with_the_reason(
    tmp_path: Path, header: str, columns, words: str
) -> None:
    path = csv(tmp_path / 'a.csv', header, *columns)
    with pytest.raises(IdentificationError, match=words):
        read_table(path, JOINTS)


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (b'PK nothing', 'is not a table of numbers'),
        ({'q': Q[:, :1]}, r'q has the shape \(100, 1\) instead of \(M, 2\)'),
        ({'time': T[:50]}, 'differ in length'),
        ({'position': Q}, 'arrays position and q of .* contain the same quantity'),
        ({'q': np.array([{}], dtype=object)}, 'is not a table of numbers'),
    ],
)
def test_unreadable_arrays_raise_errors(tmp_path: Path, content: bytes | dict, words: str) -> None:
    path = tmp_path / 'a.npz'
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.savez(path, **{'time': T, 'q': Q, 'tau': TAU, **content})
    with pytest.raises(IdentificationError, match=words):
        read_table(path, JOINTS)
    (tmp_path / 'a.csv').write_bytes(b'time,q1\n1.0,two\n')
    with pytest.raises(IdentificationError, match='is not a table of numbers'):
        read_table(tmp_path / 'a.csv', JOINTS)
    with pytest.raises(IdentificationError, match='check the path'):
        read_table(tmp_path / 'none.csv', JOINTS)
    with pytest.raises(IdentificationError, match='--rate 0 must be'):
        TableOptions(rate=0.0)
