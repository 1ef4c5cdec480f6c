"""Verdicts on reports with known errors; the arm is the packaged one."""

import re
from dataclasses import replace
from math import pi

import pytest

from aerarm_ros.commissioning.commissioning import (
    drive_findings,
    pulse_offset,
    return_findings,
    turn_findings,
)
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.boards.commissioning_probe import ProbeReport, Stroke

CONFIG = load_arm_config()
TURN = 0.5 * pi
JOINT = 2  # with limits that are symmetric, 31 motor turns per turn
NONE = (0.0,) * 4


def at(value, joint=JOINT, other=0.0):
    return tuple(value if i == joint else other for i in range(4))


def report(**changes) -> ProbeReport:
    texts = ('a:1', 'watching', '', 'idle', CONFIG.joint_names, ('',) * 4)
    return replace(ProbeReport(*texts, NONE, NONE, (0,) * 4, (None,) * 4), **changes)


def turned(motor_turns=31.0, joint=JOINT, pulses=None, sign=1.0):
    angle = motor_turns * TURN
    count = round(angle / (2.0 * pi)) if pulses is None else pulses
    return report(travel=at(sign * angle, joint), span=at(angle, joint), pulses=at(count, joint, 0))


def driven(friction=0.122, delivered=1.0, span=31.0 * 0.24, speed=0.15, joint=JOINT, **changes):
    current = friction / CONFIG.joints[joint].torque_per_ampere
    up = Stroke(current / delivered, current, speed)
    down = Stroke(-current / delivered, -current, -speed)
    given = {'phase': 'done', 'span': at(span, joint), 'strokes': (up, down), 'current_max': 1.0}
    return report(**{**given, **changes})


def test_errors_of_a_manufactured_arm_pass():
    for off in (-0.045, 0.0, 0.045):
        findings, measured = turn_findings(CONFIG, JOINT, TURN, turned(31.0 * (1.0 + off)))
        assert (findings, measured['reduction']) == ([], pytest.approx(31.0 * (1.0 + off)))
    for friction in (0.122 * 0.6, 0.122, 0.122 * 1.5):
        findings, measured = drive_findings(CONFIG, JOINT, driven(friction, delivered=0.98))
        assert (findings, measured['friction']) == ([], pytest.approx(friction))
        assert measured['delivered'] == pytest.approx(0.98)


@pytest.mark.parametrize(
    ('watched', 'finding'),
    [
        (turned(27.0), r'27.00 turns per turn of the joint, .* states 31 \(-13 %\)'),
        (turned(31.0 * 1.06), r'\(\+6 %\)'),
        (turned(sign=-1.0), 'counts in the opposite direction .* set sign: -1'),
        (turned(joint=3), r'the encoder of joint4 counted\. Swap .* joint4: 1, 1\)'),
        (turned(2.0), 'no encoder counted'),
        (turned(pulses=0), '0 index pulses in 7.8 motor turns'),
        (replace(turned(), span=(0.0, 27.0 * 0.6, 31.0 * TURN, 0.0)), 'joint2 turned as well'),
    ],
)
def test_a_turn_that_contradicts_the_configuration_is_found(watched, finding):
    findings, _ = turn_findings(CONFIG, JOINT, TURN, watched)
    assert len(findings) == 1
    assert findings[0].startswith('joint3: ')
    assert re.search(finding, findings[0])


def test_a_turn_in_the_negative_direction_is_judged_by_its_own_sign():
    assert turn_findings(CONFIG, JOINT, -TURN, turned(sign=-1.0))[0] == []
    assert 'set sign: -1' in turn_findings(CONFIG, JOINT, -TURN, turned())[0][0]


def test_a_joint_that_does_not_come_back_to_its_mark_is_found():
    assert return_findings(CONFIG, JOINT, report(travel=at(31.0 * 0.04))) == []
    (finding,) = return_findings(CONFIG, JOINT, report(travel=at(31.0 * -0.06)))
    assert 'the encoder angle is off by -0.060 rad' in finding


@pytest.mark.parametrize(
    ('after', 'finding'),
    [
        (driven(delivered=0.5), 'the driver delivers 50 % of the requested current'),
        (driven(delivered=1.5), 'the driver delivers 150 %'),
        (driven(friction=0.5), 'friction is 0.500 Nm, but the configuration states 0.122 Nm'),
        (driven(span=0.1), 'did not move at 0.85 Nm. Possible causes: too much friction'),
        (driven(span=27.0 * 0.24, joint=3), ('did not move the joint; joint4 moved instead')),
        (driven(speed=-0.15), 'moved at -0.15 and +0.15 rad/s instead of +0.15 and -0.15'),
        (driven(phase='failed', reason='board1: error 6'), 'not drive the motor (board1: error 6'),
        (replace(driven(), span=(0.0, 0.0, 31.0 * 0.24, 27.0 * 0.24)), 'joint4 moved as well'),
    ],
)
def test_a_drive_that_went_wrong_is_found(after, finding):
    findings, _ = drive_findings(CONFIG, JOINT, after)
    assert len(findings) == 1
    assert finding in findings[0]


def test_the_load_of_a_drive_is_the_mean_of_both_directions():
    up, down = Stroke(0.5, 0.5, 0.15), Stroke(0.2, 0.2, -0.15)
    _, measured = drive_findings(CONFIG, JOINT, driven(strokes=(up, down)))
    effort = CONFIG.joints[JOINT].torque_per_ampere
    assert measured['load'] == pytest.approx(0.35 * effort)
    assert measured['friction'] == pytest.approx(0.15 * effort)


def test_the_pulse_offset_counts_from_the_home_configuration():
    seen = report(pulse_angle=at(1.0, JOINT, None))
    assert pulse_offset(CONFIG, JOINT, 6.0, seen) == pytest.approx(7.0 - 2.0 * pi)
    assert pulse_offset(CONFIG, 0, 6.0, seen) is None
