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


def test_joints_are_ordered_by_name(states) -> None:
    order = [2, 0, 3, 1]
    shuffled = replace(
        states,
        names=tuple(JOINTS[i] for i in order),
        position=states.position[:, order],
        velocity=states.velocity[:, order],
        effort=states.effort[:, order],
    )
    recording = recording_from_states('bag', shuffled, JOINTS, AS_IS)
    rows = np.searchsorted(states.stamp, recording.start + recording.time)
    assert np.array_equal(recording.q, states.position[rows])
    assert np.array_equal(recording.tau, states.effort[rows])
    assert recording.start == states.stamp[0]


def test_renaming_ignoring_and_gains(states) -> None:
    more = replace(
        states,
        names=('a1', 'joint2', 'joint3', 'joint4', 'gripper'),
        position=np.pad(states.position, ((0, 0), (0, 1))),
        velocity=np.pad(states.velocity, ((0, 0), (0, 1))),
        effort=np.pad(states.effort, ((0, 0), (0, 1))),
    )
    mapping = JointMapping({'a1': 'joint1'}, ('gripper',), effort_gain={'joint2': 0.5})
    recording = recording_from_states('bag', more, JOINTS, mapping)
    rows = np.searchsorted(states.stamp, recording.start + recording.time)
    assert np.array_equal(recording.q, states.position[rows])
    assert np.array_equal(recording.tau[:, 1], 0.5 * states.effort[rows, 1])
    with pytest.raises(IdentificationError, match='gripper of .* are missing from the URDF'):
        recording_from_states('bag', more, JOINTS, JointMapping({'a1': 'joint1'}))
    with pytest.raises(IdentificationError, match='joint1 of the URDF are not in'):
        recording_from_states('bag', more, JOINTS, JointMapping({}, ('gripper',)))
    with pytest.raises(IdentificationError, match=r'joint b \(--ignore\) is not in .*joint1'):
        recording_from_states('bag', more, JOINTS, JointMapping({'a1': 'joint1'}, ('gripper', 'b')))
    with pytest.raises(IdentificationError, match='called joint2 after renaming'):
        recording_from_states(
            'bag', more, JOINTS, JointMapping({'a1': 'joint1', 'gripper': 'joint2'})
        )
    with pytest.raises(IdentificationError, match=r'joint b \(--rename\) is not in'):
        recording_from_states('bag', more, JOINTS, JointMapping({'b': 'joint1'}))


def test_missing_or_zero_velocities_are_derived_later(states) -> None:
    for value in (np.nan, 0.0):
        without = changed(states, 'velocity', slice(None), slice(None), value)
        recording = recording_from_states('bag', without, JOINTS, AS_IS)
        assert recording.dq is None
        assert 'differentiated' in recording.warnings[0]


@pytest.mark.parametrize(
    ('field', 'rows', 'columns', 'value', 'text'),
    [
        (
            'effort',
            slice(100, 103),
            2,
            np.nan,
            r'effort of joints joint3 in bag is NaN .* in 3 of ',
        ),
        ('effort', slice(None), slice(None), np.nan, 'no effort of joints joint1, joint2'),
        ('effort', slice(None), slice(None), 0.0, 'effort of every joint in .* is constant'),
        ('position', slice(500, 506), 0, np.inf, 'position of joints joint1'),
        (
            'effort',
            slice(500, 506),
            1,
            1e308,
            r'effort of joints joint2 in bag reaches 1e\+308 in 6 of',
        ),
        ('position', slice(None), slice(None), 1.0, 'no joint moves'),
    ],
)
def test_useless_data_is_refused(states, field, rows, columns, value, text) -> None:
    with pytest.raises(IdentificationError, match=text):
        recording_from_states('bag', changed(states, field, rows, columns, value), JOINTS, AS_IS)


def test_single_faulty_joints_are_named(states) -> None:
    dead = changed(states, 'effort', slice(None), 3, 0.7)
    recording = recording_from_states('bag', dead, JOINTS, AS_IS)
    assert recording.dead_effort.tolist() == [False, False, False, True]
    assert recording.warnings == (
        'bag: joint joint4 has a constant effort, so its torque is ignored',
    )
    still = changed(states, 'position', slice(None), 1, 0.2)
    recording = recording_from_states('bag', still, JOINTS, AS_IS)
    assert 'joint joint2 does not move' in recording.warnings[0]


def test_standstill_at_both_ends_and_its_defects_are_ignored(states) -> None:
    """A gap of the stamps and missing efforts before the motion don't matter."""
    early = states.stamp.copy()
    early[:40] -= 0.337
    idle = changed(replace(states, stamp=early), 'effort', slice(0, 30), 1, np.nan)
    recording = recording_from_states('bag', idle, JOINTS, AS_IS)
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
        recording_from_states('bag', states, JOINTS[:3], mapping)
    held = changed(states, 'position', slice(None), 3, 0.2)
    assert recording_from_states('bag', held, JOINTS[:3], mapping).q.shape[1] == 3


@pytest.mark.parametrize(
    ('facts', 'states', 'said'),
    [
        (BagFacts('', 0, 1207), 25_032, 'bag: 4.6 % of the cycles were missed, '),
        (BagFacts('', 100, 11), 889, 'bag: 1.1 % of the cycles were missed, '),
        (BagFacts('', None, 11), 989, 'bag: 1.1 % of the cycles were missed, '),
    ],
)
def test_many_missed_cycles_are_warned_of(facts: BagFacts, states: int, said: str) -> None:
    (warning,) = facts.warnings('bag', states)
    assert warning.startswith(said)
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
        recording_from_states('bag', replace(states, **few), JOINTS, AS_IS)


def test_a_prefix_is_taken_off(states) -> None:
    prefixed = replace(states, names=tuple(f'left_{name}' for name in states.names))
    recording = recording_from_states('bag', prefixed, JOINTS, JointMapping({}, prefix='left_'))
    assert recording.joint_names == JOINTS
    with pytest.raises(IdentificationError, match='not in .*, which has left_joint1.*--tf-pre'):
        recording_from_states('bag', prefixed, JOINTS, AS_IS)
