import re
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from aerarm_ros.commissioning.commissioning_record import (
    CommissioningRecord,
    JointRecord,
    load_record,
    record_path,
)
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import ConfigError

CONFIG = load_arm_config()
NOW = datetime(2026, 3, 1, 12, 30, tzinfo=UTC)


def commissioned(findings=(), **measured) -> CommissioningRecord:
    numbers = {'pulse_offset': 1.25, 'reduction': 31.01, **measured}
    joints = {joint.name: JointRecord.of(joint, NOW, findings, numbers) for joint in CONFIG.joints}
    return CommissioningRecord(CONFIG.name, False, NOW, joints)


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'arm.commissioning.yaml'


def changed(joint=1, **fields):
    joints = list(CONFIG.joints)
    joints[joint] = replace(joints[joint], **fields)
    return replace(CONFIG, joints=tuple(joints))


def test_a_record_is_read_as_it_was_written(path):
    record = commissioned(['joint1: a finding'])
    record.save(path)
    loaded = load_record(path)
    assert loaded == replace(record, joints=loaded.joints)
    assert record_path(path.with_name('arm.yaml')) == path
    for name, entry in record.joints.items():
        read = loaded.joints[name]
        assert (read.date, read.findings) == (NOW, entry.findings)
        assert read.measured == pytest.approx(entry.measured)
        assert read.configuration == pytest.approx(entry.configuration, abs=1e-6)


def test_a_commissioned_arm_has_no_problem_and_pulse_offsets(path):
    assert replace(commissioned(), emulated=True).problem(CONFIG, emulated=True) == ''
    prefixed = commissioned().with_prefix('left_')
    assert prefixed.problem(CONFIG.with_prefix('left_')) == ''
    commissioned().save(path)
    record = load_record(path)
    assert record.problem(CONFIG) == ''
    assert record.open_joints(CONFIG) == []
    assert record.pulse_offset(CONFIG) == pytest.approx([1.25] * 4)


@pytest.mark.parametrize(
    ('record', 'problem'),
    [
        (CommissioningRecord('aerarm'), 'joint1, joint2, joint3, joint4 not commissioned'),
        (replace(commissioned(), arm='other'), 'belongs to arm other, not to aerarm'),
        (replace(commissioned(), emulated=True), 'to an emulated arm'),
        (commissioned(['joint1: rubs']), r'joint1, .* did not pass .*\(joint1: rubs\)'),
    ],
)
def test_the_record_states_why_an_arm_is_not_commissioned(record, problem):
    assert re.search(problem, record.problem(CONFIG))
    assert "'arm commission'" in record.problem(CONFIG)


@pytest.mark.parametrize(('fields', 'key'), [({'sign': -1}, 'sign'), ({'offset': 0.1}, 'offset')])
def test_a_configuration_that_changed_needs_the_joint_again(fields, key):
    record, config = commissioned(), changed(**fields)
    assert record.problem(config).startswith(f'joint2 commissioned with another {key}')
    assert record.open_joints(config) == [1]
    # The other joints keep theirs.
    assert record.pulse_offset(config) == pytest.approx([1.25, 0.0, 1.25, 1.25])


def test_a_joint_without_a_pulse_has_no_offset():
    record = commissioned()
    entry = record.joints['joint3']
    bare = replace(entry, measured={'reduction': 31.0})
    record = replace(record, joints={**record.joints, 'joint3': bare})
    assert record.pulse_offset(CONFIG) == pytest.approx([1.25, 1.25, 0.0, 1.25])
    assert record.problem(CONFIG).startswith(
        'joint3 commissioned without an angle of the index pulse (pulse_offset)'
    )
    assert record.open_joints(CONFIG) == [2]


@pytest.mark.parametrize(
    ('old', 'new', 'error'),
    [
        ('format: 1', 'format: 2', 'format = 2 must be 1'),
        ('pulse_offset: 1.25', 'pulse_offset: 7.0', 'must lie between 0 and 2 pi'),
        ('pulse_offset: 1.25', 'pulse_offset: .nan', 'pulse_offset = nan is not a number'),
        ('passed: true', 'passed: false', "'passed' and 'findings' contradict"),
        ('joints:', 'others:', 'joints = None is not a mapping'),
        ("date: '2026-03-01T12:30:00+00:00'", 'date: yesterday', "'yesterday' is not a date"),
    ],
)
def test_a_wrong_record_is_one_clear_error(path, old, new, error):
    commissioned().save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=error) as raised:
        load_record(path)
    assert str(path) in str(raised.value)
    path.write_text(text[:300])
    with pytest.raises(ConfigError):
        load_record(path)
