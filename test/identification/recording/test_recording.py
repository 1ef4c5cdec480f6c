"""Joint states become a recording of the motion, or an error that says what to check."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import (
    BagFacts,
    JointMapping,
    moving_span,
    recording_from_states,
    running_span,
)

JOINTS = ('joint1', 'joint2', 'joint3', 'joint4')
AS_IS = JointMapping({})


@pytest.fixture(scope='module')
def states(make_arm: Callable):
    return make_arm(rate=100.0).states(1)


def changed(states, field: str, rows: slice, columns: object, value: float):
    values = getattr(states, field).copy()
    values[rows, columns] = value
    return replace(states, **{field: values})


def recorded(states, mapping: JointMapping = AS_IS, joints: tuple[str, ...] = JOINTS):
    return recording_from_states('bag', states, joints, mapping)


def test_joints_are_ordered_by_name(states) -> None:
    order = [2, 0, 3, 1]
    arrays = {f: getattr(states, f)[:, order] for f in ('position', 'velocity', 'effort')}
    recording = recorded(replace(states, names=tuple(JOINTS[i] for i in order), **arrays))
    rows = np.searchsorted(states.stamp, recording.start + recording.time)
    assert np.array_equal(recording.q, states.position[rows])
    assert np.array_equal(recording.tau, states.effort[rows])
    assert recording.start == states.stamp[0]


def test_renaming_ignoring_and_gains(states) -> None:
    arrays = {
        f: np.pad(getattr(states, f), ((0, 0), (0, 1))) for f in ('position', 'velocity', 'effort')
    }
    more = replace(states, names=('a1', 'joint2', 'joint3', 'joint4', 'gripper'), **arrays)
    named = {'a1': 'joint1'}
    recording = recorded(more, JointMapping(named, ('gripper',), effort_gain={'joint2': 0.5}))
    rows = np.searchsorted(states.stamp, recording.start + recording.time)
    assert np.array_equal(recording.q, states.position[rows])
    assert np.array_equal(recording.tau[:, 1], 0.5 * states.effort[rows, 1])
    for mapping, words in (
        (JointMapping(named), 'gripper of .* are missing from the URDF'),
        (JointMapping({}, ('gripper',)), 'joint1 of the URDF are not in'),
        (JointMapping(named, ('gripper', 'b')), r'joint b \(--ignore\) is not in .*joint1'),
        (JointMapping({**named, 'gripper': 'joint2'}), 'called joint2 after renaming'),
        (JointMapping({'b': 'joint1'}), r'joint b \(--rename\) is not in'),
    ):
        with pytest.raises(IdentificationError, match=words):
            recorded(more, mapping)
    prefixed = replace(states, names=tuple(f'left_{name}' for name in states.names))
    assert recorded(prefixed, JointMapping({}, prefix='left_')).joint_names == JOINTS
    with pytest.raises(IdentificationError, match='not in .*, which has left_joint1.*--tf-pre'):
        recorded(prefixed)


ALL = slice(None)


@pytest.mark.parametrize(
    ('field', 'rows', 'columns', 'value', 'text'),
    [
        ('effort', slice(100, 103), 2, np.nan, 'effort of joints joint3 in bag is NaN .* in 3 of '),
        ('effort', ALL, ALL, np.nan, 'no effort of joints joint1, joint2'),
        ('effort', ALL, ALL, 0.0, 'effort of every joint in .* is constant'),
        ('position', slice(500, 506), 0, np.inf, 'position of joints joint1'),
        ('effort', slice(500, 506), 1, 1e308, r'joint2 in bag reaches 1e\+308 in 6 of'),
        ('position', ALL, ALL, 1.0, 'no joint moves'),
    ],
)
def test_useless_data_is_refused(states, field, rows, columns, value, text) -> None:
    with pytest.raises(IdentificationError, match=text):
        recorded(changed(states, field, rows, columns, value))


@pytest.mark.parametrize(
    ('field', 'column', 'value', 'words'),
    [
        ('velocity', ALL, np.nan, 'positions are differentiated instead'),
        ('velocity', ALL, 0.0, 'positions are differentiated instead'),
        ('effort', 3, 0.7, 'bag: joint joint4 has a constant effort, so its torque is ignored'),
        ('position', 1, 0.2, 'joint joint2 does not move'),
    ],
)
def test_faulty_signals_are_named_and_replaced(states, field, column, value, words) -> None:
    recording = recorded(changed(states, field, ALL, column, value))
    assert words in recording.warnings[0]
    assert (recording.dq is None) == (field == 'velocity')
    assert recording.dead_effort.tolist() == [False, False, False, field == 'effort']


def test_standstill_at_both_ends_and_its_defects_are_ignored(states) -> None:
    """A gap of the stamps and missing efforts before the motion don't matter."""
    early = states.stamp.copy()
    early[:40] -= 0.337
    idle = changed(replace(states, stamp=early), 'effort', slice(0, 30), 1, np.nan)
    recording = recorded(idle)
    assert recording.span is not None
    assert recording.span.reason == 'motion'
    assert recording.span.first == pytest.approx(recording.time[0])
    assert 0.5 < recording.span.first < 1.5
    assert recording.span.whole == pytest.approx(26.0 + 0.337, abs=0.02)
    assert 'NaN' not in ' '.join(recording.warnings)


def test_a_locked_joint_rests(states) -> None:
    mapping = JointMapping({}, locked=('joint4',))
    text = r'joint4 is locked \(--lock\) but moves by [\d.]+ rad in bag: remove --lock joint4'
    with pytest.raises(IdentificationError, match=text):
        recorded(states, mapping, JOINTS[:3])
    held = changed(states, 'position', slice(None), 3, 0.2)
    assert recorded(held, mapping, JOINTS[:3]).q.shape[1] == 3


@pytest.mark.parametrize(
    ('lost', 'missed', 'states', 'share'),
    [(0, 1207, 25_032, '4.6'), (100, 11, 889, '1.1'), (None, 11, 989, '1.1')],
)
def test_many_missed_cycles_are_warned_of(lost, missed: int, states: int, share: str) -> None:
    (warning,) = BagFacts('', lost, missed).warnings('bag', states)
    assert warning.startswith(f'bag: {share} % of the cycles were missed, ')
    assert 'config/parameters_spi.yaml' in warning


TIME = 100.0 + 0.01 * np.arange(2000)


def positions(*motions: tuple[int, int, float]) -> np.ndarray:
    """Two joints that move between rows, by a size, and rest (with noise) otherwise."""
    q = np.full((2000, 2), 0.3)
    for first, last, size in motions:
        phase = np.linspace(0.0, 2.0 * np.pi, last - first)
        q[first:last, 1] += size * np.sin(phase) ** 2
        q[last:, 1] += 1e-6
    return q + 2e-5 * np.random.default_rng(0).standard_normal(q.shape)


def test_the_liveliest_run_is_used() -> None:
    q = positions((300, 500, 0.1), (900, 1500, 1.0), (1600, 1900, 2.0))
    modes = [
        *((TIME[200], 'running'), (TIME[600], 'ready'), (TIME[800], 'running')),
        (TIME[1550], 'damping'),
    ]
    # The mode in force when recording began is the first one announced.
    assert running_span(TIME, q, modes) == (
        slice(800, 1550),
        'arm_mode running, the longest of 2 motions',
    )
    assert running_span(TIME, q, modes[2:]) == (slice(0, 1550), 'arm_mode running')
    assert running_span(TIME, q, modes[:1]) == (slice(0, 2000), 'arm_mode running')


def test_rest_before_and_after_a_motion_is_left_out() -> None:
    part, reason = moving_span(TIME, positions((600, 1400, 1.0)))
    assert reason == 'motion'
    # Half a second of it stays as the filters' past.
    assert part.start == pytest.approx(600 - 50, abs=15)
    assert part.stop == pytest.approx(1400 + 50, abs=15)
    assert moving_span(TIME, positions((0, 2000, 1.0))) == (slice(0, 2000), 'whole bag')
    assert moving_span(TIME, np.zeros((2000, 2))) == (slice(0, 2000), 'whole bag')


def test_too_few_messages(states) -> None:
    few = {f: getattr(states, f)[:9] for f in ('stamp', 'position', 'velocity', 'effort')}
    with pytest.raises(IdentificationError, match='only 9 joint states, too few'):
        recorded(replace(states, **few))
