"""`contact_estimator --bag` on recordings of the emulated arm, one of which is bad."""

import json
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from carrying_run import CarryingRun
from touched_run import Touch, detector, recording

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.online.contact_detector import Cause
from aerarm_ros.online.contact_place import ContactLocator
from aerarm_ros.online.external_torque import ResidualBound
from aerarm_ros.ros.programs.contact_replay import contact_page, contact_replay, search

PUSH = Touch(4.0, 4.8, (6.0, 6.0, 6.0))


def write_table(path: Path, motion: Recording) -> str:
    """Write a recording as .csv with the joint names of the packaged arm."""
    names = motion.joint_names
    fields = ['position', 'velocity', 'effort']
    header = ','.join(['time', *(f'{name}.{field}' for field in fields for name in names)])
    assert motion.dq is not None
    rows = np.hstack([motion.time[:, None], motion.q, motion.dq, motion.tau])
    np.savetxt(path, rows, delimiter=',', header=header, comments='')
    return str(path)


@pytest.fixture
def pushed(free: CarryingRun) -> Recording:
    return PUSH.added(free, recording(free, 0.7, 6.5))


def test_a_push_is_found_and_described(
    free: CarryingRun, bound: ResidualBound, pushed: Recording
) -> None:
    bag = search(pushed, detector(free, bound), ContactLocator(free.robot()))
    ((event, place),) = zip(bag.events, bag.places, strict=True)
    assert event.cause is Cause.CONTACT
    assert 0.0 < event.begin - PUSH.begin < 0.05
    assert place is not None
    assert place.link == free.robot().link_names[-1]
    # Whatever the point, the force explains the torque.
    assert np.linalg.norm(place.force) == pytest.approx(np.linalg.norm(PUSH.force), rel=0.5)
    (text,) = bag.event_texts()
    assert text.startswith(f'{event.begin:.2f} s to {event.end:.2f} s: contact, torque of joint')
    html = contact_page([bag], {'other': ValueError('other.csv is empty')})
    assert text in unescape(html)
    assert 'other.csv is empty' in html


def test_frozen_torque_at_the_end_leaves_the_events_before_it(
    free: CarryingRun, bound: ResidualBound, pushed: Recording
) -> None:
    pushed.tau[pushed.time > 5.5] = pushed.tau[pushed.time > 5.5][0]
    bag = search(pushed, detector(free, bound), ContactLocator(free.robot()))
    ((problem, ((begin, end),)),) = bag.problems.items()
    assert 'stays at' in problem
    assert begin == pytest.approx(5.5, abs=0.3)
    assert end == pytest.approx(6.5, abs=0.1)
    assert [event.cause for event in bag.events][:1] == [Cause.CONTACT]


def test_one_bad_bag_does_not_lose_the_others(
    free: CarryingRun, pushed: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = write_table(tmp_path / 'pushed.csv', pushed)
    bare = write_table(tmp_path / 'free.csv', recording(free, 0.7, 9.0))
    config = load_arm_config()
    assert config.joint_names == pushed.joint_names
    (tmp_path / 'empty.csv').write_text('')
    out = tmp_path / 'out'
    arguments = ['--free', bare, '--bag', str(tmp_path / 'empty.csv'), good, '--out', str(out)]
    assert contact_replay('contact_estimator', arguments) == 2
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert line.startswith('contact_estimator: ')
    assert 'empty.csv' in line
    assert 'pushed.csv: ' in printed.out
    assert 'Report: ' in printed.out
    summary = json.loads((out / 'summary.json').read_text())
    (found,) = summary['contacts']
    event = found['events'][0]
    assert event['cause'] == Cause.CONTACT.value
    assert event['link'] in load_robot().link_names
    assert len(event['torque']) == len(config.joint_names)
    assert len(event['force']) == len(event['point']) == 3
    assert isinstance(event['force_is_determined'], bool)
    assert list(summary['failures']) == [str(tmp_path / 'empty.csv')]
    assert 'empty.csv' in (out / 'contacts.html').read_text()
