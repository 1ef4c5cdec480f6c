"""The guided procedure on `BridgeCycle`, emulated boards and MuJoCo's arm, in virtual time."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from commissioning_campaign import CommissionedArm

from aerarm_ros.commissioning.commissioning import Commissioning, turn_prompts
from aerarm_ros.commissioning.commissioning_record import CommissioningRecord
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.boards.commissioning_probe import ProbeReport, ProbeRequest

CONFIG, ROBOT = load_arm_config(), load_robot()
NOW = datetime(2026, 3, 1, tzinfo=UTC)


def drive(arm, joint='joint4', id_='me:1'):
    return arm.ask(ProbeRequest(id_, 'drive', joint))


def run(arm, seconds, joint='joint4', id_='me:1'):
    """Repeat a request every 0.1 s; return the last answer."""
    for _ in range(round(10 * seconds)):
        report = drive(arm, joint, id_)
        arm.pass_time(0.1)
    return report


def aligned(arm):
    """Switch the motor of joint4 on, declare it aligned, and begin to drive."""
    drive(arm)
    arm.pass_time(0.01)
    arm.boards.boards[1].motors[1].ready = True
    arm.pass_time(0.02)
    assert drive(arm).phase == 'driving'
    return arm


def test_a_healthy_joint_passes_and_its_numbers_are_those_of_the_arm():
    arm = CommissionedArm(seed=1)
    record = arm.commission([3])
    entry = record.joints['joint4']
    assert entry.findings == ()
    truth = arm.boards.plant.parameters
    assert entry.measured['reduction'] == pytest.approx(27.0, rel=0.02)
    assert entry.measured['friction'] == pytest.approx(truth.coulomb[3], rel=0.05)
    assert entry.measured['delivered'] == pytest.approx(1.0, abs=0.02)
    # The hand placed the joint to 0.01 rad, of which the motor makes 27 times as much.
    assert entry.measured['pulse_offset'] == pytest.approx(0.0, abs=0.28)
    assert list(record.joints) == ['joint4']
    assert arm.bridge.mode == 'unhomed'
    assert 'Motors are off. Put joint4 at its home configuration, 0 rad' in arm.prompts[0]
    assert 'THE ARM MOVES' in arm.prompts[-1]


@pytest.mark.parametrize(
    ('fault', 'finding'),
    [
        ('swapped_channels:1', 'the encoder of joint3 counted'),
        ('dead_board:1', 'board1 does not answer'),
    ],
)
def test_an_error_found_by_hand_ends_the_joint_before_its_motor_is_driven(fault, finding):
    arm = CommissionedArm(1, fault)
    (text,) = arm.commission([3]).joints['joint4'].findings
    assert finding in text
    assert not any('THE ARM MOVES' in prompt for prompt in arm.prompts)


def is_off(arm) -> bool:
    return not any(board.system_enabled for board in arm.boards.boards)


def test_only_the_motor_of_the_joint_is_switched_on():
    arm = aligned(CommissionedArm(None))
    before = arm.boards.plant.position
    assert arm.bridge.mode == 'commissioning'
    on = [motor.enabled for board in arm.boards.boards for motor in board.motors]
    assert on == [False, False, False, True]
    run(arm, 0.8)
    moved = abs(arm.boards.plant.position - before)
    assert 0.05 < moved[3] < 0.13
    assert moved[:3].max() < 1e-3
    assert abs(arm.bridge.motor_current[3]) < 0.6


def test_a_weak_driver_is_detected_by_its_measured_current():
    arm = aligned(CommissionedArm(1, 'weak_driver:1:1'))
    report = run(arm, 4.3)
    assert report.phase == 'done'
    up, down = report.strokes
    assert up.measured / up.requested == pytest.approx(0.5, abs=0.03)
    assert down.measured / down.requested == pytest.approx(0.5, abs=0.03)


def test_the_motor_is_off_when_the_client_falls_silent():
    arm = aligned(CommissionedArm(None))
    arm.pass_time(0.9)
    assert arm.bridge.mode == 'commissioning'
    arm.pass_time(0.2)
    assert arm.bridge.mode == 'unhomed'
    assert is_off(arm)
    assert drive(arm).reason == 'no request for 1 s: the client has stopped'
    assert drive(arm).phase == 'failed'  # the same request starts nothing again


@pytest.mark.parametrize('stop', ['disable', 'e_stop', 'off'])
def test_a_stop_switches_the_motor_off(stop):
    arm = aligned(CommissionedArm(None))
    {
        'disable': arm.bridge.disable,
        'e_stop': lambda: arm.bridge.e_stop('a test'),
        'off': lambda: arm.ask(ProbeRequest('me:2', 'off')),
    }[stop]()
    arm.pass_time(0.02)
    assert arm.bridge.mode == ('fault' if stop == 'e_stop' else 'unhomed')
    assert is_off(arm)


def test_a_motor_that_runs_away_is_switched_off():
    arm = aligned(CommissionedArm(None))
    run(arm, 0.5)
    # Phases that were turned over after the alignment: torque against the encoder's direction.
    arm.boards._effort_per_current[3] *= -1.0
    fastest = 0.0
    for _ in range(300):
        arm.pass_time(0.001)
        fastest = max(fastest, abs(arm.boards.plant.velocity[3]))
    assert 'its motor turns against its encoder' in drive(arm).reason
    assert is_off(arm)
    assert fastest < 1.0


def test_wrong_joints_enabled_arms_and_other_clients_are_rejected():
    arm = CommissionedArm(None)
    arm.pass_time(0.02)
    assert drive(arm, 'joint9', 'me:2').phase == 'failed'
    assert arm.bridge.home().accepted  # the mode is still that of the last cycle
    assert 'disable the arm first' in drive(arm).reason
    arm = aligned(CommissionedArm(None))
    for answer in (arm.bridge.enable(), arm.bridge.home()):
        assert not answer.accepted
        assert 'joint4 is being commissioned' in answer.message
    other = arm.ask(ProbeRequest('you:1', 'off'))
    assert (other.phase, 'by another client' in other.reason) == ('failed', True)
    assert drive(arm).phase == 'driving'


def seen(guided: Commissioning, **changes) -> ProbeReport:
    """Return the bridge's answer to the present request, while it watches."""
    none = {'travel': (0.0,) * 4, 'span': (0.0,) * 4, 'pulses': (0,) * 4}
    given = {**none, 'pulse_angle': (None,) * 4, 'boards': ('',) * 4, **changes}
    fixed = {'reason': '', 'mode': 'idle', 'joints': CONFIG.joint_names}
    return ProbeReport(guided.request.id, 'watching', **fixed, **given)


def test_a_step_that_is_left_out_does_not_pass():
    guided = Commissioning(CONFIG, ROBOT, CommissioningRecord('aerarm'), [0], 'me')
    guided.update(NOW, replace(seen(guided), id='me:other', phase='failed', reason='old'))
    assert guided.prompt is None
    guided.update(NOW, seen(guided))
    assert 'Put joint1' in guided.prompt.text
    guided.answer(False)
    assert 'The motor of joint1 aligns' in guided.prompt.text
    guided.answer(False)
    assert guided.is_done
    assert guided.request.kind == 'off'
    assert guided.record.joints['joint1'].findings == ('joint1: skipped by the user',) * 2


def test_a_joint_is_turned_where_it_has_room():
    prompts = [turn_prompts(CONFIG, ROBOT, joint)[1] for joint in range(4)]
    assert [prompt.hand[1] for prompt in prompts] == pytest.approx(
        [1.571, 3.142, 1.571, 1.571], abs=1e-3
    )
    assert 'counter-clockwise, seen from the tip of the base axis +z' in prompts[0].text
    assert 'the tool starts to move along the base axis -x' in prompts[1].text


def test_a_turn_without_a_clear_pulse_does_not_pass():
    guided = Commissioning(CONFIG, ROBOT, CommissioningRecord('aerarm'), [3], 'me')
    turned = 0.5 * np.pi / CONFIG.joints[3].gear.ratio
    counts = {
        'travel': (0.0, 0.0, 0.0, CONFIG.joints[3].sign * turned),
        'span': (0.0, 0.0, 0.0, turned),
        'pulses': (0, 0, 0, round(turned / (2.0 * np.pi))),
    }
    for answer in (True, True, True, False):
        guided.update(NOW, seen(guided, **counts))
        guided.answer(answer)
    guided.answer(False)
    findings = guided.record.joints['joint4'].findings
    assert [finding for finding in findings if 'no index pulse' in finding]


def test_messages_are_read_as_they_were_sent():
    arm = CommissionedArm(None)
    request = ProbeRequest('me:1', 'watch')
    assert ProbeRequest.parse(request.text()) == request
    report = arm.ask(request)
    assert ProbeReport.parse(report.text()) == report
    fields = json.loads(report.text())
    for change in (
        {'travel': 'x'},
        {'travel': [10**400] * 4},
        {'joints': 'x'},
        {'joints': [5] * 4},
        {'current_max': 10**400},
        {'pulse_angle': ['x'] * 4},
        {'boards': [5] * 4},
        {'reason': 5},
        {'strokes': [{'requested': 'a', 'measured': 1.0, 'speed': 1.0}] * 2},
    ):
        with pytest.raises(ValueError, match='not a commissioning report'):
            ProbeReport.parse(json.dumps(fields | change))
    wrong = '{"id": 1, "kind": "drive"}', '{"id": "a:1", "kind": "x"}'
    for text in ('[]', '[' * 1000, '[' * 100_000, *wrong):
        with pytest.raises(ValueError, match='commissioning'):
            ProbeRequest.parse(text)
        with pytest.raises(ValueError, match='commissioning'):
            ProbeReport.parse(text)
