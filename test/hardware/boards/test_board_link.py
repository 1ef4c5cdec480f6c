"""One board under the bridge's commands, on an emulated board with fixed motor shafts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.hardware.boards.board_link import ArmMeasurements, make_links, resistance_by_boards
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

PROFILE = load_profile()
SUBSTEP = 0.25e-3
SETTINGS = BridgeSettings()


class LoneBoards:
    """A `Transport` to boards with fixed shafts that stores sent frames."""

    def __init__(self, config, profile=PROFILE):
        motors = [[None, None], [None, None]]
        for joint in config.joints:
            motors[joint.board][joint.channel] = joint.motor
        self.profile = profile
        self.boards = [EmulatedBoard(profile, pair, SUBSTEP, seed=1) for pair in motors]
        self.now, self.duration, self.trouble = 10.0, 40e-6, ''
        self.frames = [[], []]

    def exchange(self, board, frame):
        self.frames[board].append(frame)
        return self.boards[board].exchange(frame)

    def exchange_time(self, board):
        assert board in (0, 1)
        return self.duration

    def exchanged_at(self, board):
        assert board in (0, 1)
        return self.now

    def problem(self, board):
        assert board in (0, 1)
        return self.trouble

    def commands(self, board):
        """Return the content of the frames to a board."""
        return [FrameCodec(self.profile).decode_command(frame) for frame in self.frames[board]]

    def wait(self, seconds=1e-3):
        """Advance the time of boards and host."""
        for _ in range(round(seconds / SUBSTEP)):
            self.now += SUBSTEP
            for board in self.boards:
                board.step(0.0, 0.0)
        for board in self.boards:
            board.prepare()


@pytest.fixture
def wire(config):
    return LoneBoards(config)


@pytest.fixture
def links(config, wire):
    return make_links(config, PROFILE, SETTINGS, wire)


@pytest.fixture
def references(config):
    return MotorReferences(config, PROFILE, reach_max=0.5)


def talk(links, wire, references, cycles=1, enable=False, running=False):
    for _ in range(cycles):
        wire.wait()
        for link in links:
            link.exchange(references, enable, running)


def drive(links, wire, references):
    """Let the boards drive motors that are already aligned."""
    talk(links, wire, references, 10)
    for board in wire.boards:
        for motor in board.motors:
            motor.ready = True
    talk(links, wire, references, 5, enable=True)
    assert all(link.is_aligned and link.may_be_damped for link in links)


def test_each_joint_has_its_boards_channel_and_a_saturation_that_its_limit_gives(
    config, links, wire, references
):
    references.set_gains(1.0, 0.6)
    references.damp(np.array([100.0, 100.0, 100.0, 100.0]))
    for number, motor in enumerate(references.motors):
        motor.position, motor.current = 0.1 + number, 0.2 + number
    drive(links, wire, references)
    for number, joint in enumerate(config.joints):
        motor = wire.boards[joint.board].motors[joint.channel]
        assert motor.position == pytest.approx(0.1 + number, abs=1e-3)
        assert motor.current == pytest.approx(0.2 + number, abs=1e-3)
        assert motor.kd == pytest.approx(references.motors[number].kd, abs=1e-3)
        strongest = min(joint.effort_max / joint.torque_per_ampere, joint.motor.current_max)
        assert motor.current_saturation == pytest.approx(strongest, rel=0.01)
    references.motors[0].current_max = 0.0
    talk(links, wire, references, 1, enable=True)
    assert wire.boards[0].motors[0].current_saturation == pytest.approx(0.5, abs=0.1)


def test_a_reference_that_no_frame_holds_gives_the_board_no_current(links, wire, references):
    drive(links, wire, references)
    references.motors[2].position = 1e9
    references.motors[3].current = 2.0
    talk(links, wire, references, 1, enable=True)
    assert 'outside the range' in links[1].monitor.fault
    assert links[0].monitor.fault == ''
    assert wire.boards[1].system_enabled
    assert [motor.current for motor in wire.boards[1].motors] == [0.0, 0.0]


def test_switching_off_is_a_frame_of_its_own(links, wire, references):
    drive(links, wire, references)
    for link in links:
        link.switch_off()
    assert not any(board.system_enabled for board in wire.boards)
    assert not any(motor.enabled for board in wire.boards for motor in board.motors)


def test_the_interval_between_answers_is_bounded_by_the_host_delay(links, wire, references):
    link = links[0]
    talk(links, wire, references, 3)
    assert link.fresh
    assert link.interval == pytest.approx(1e-3)
    assert link.interval_max == pytest.approx(1e-3 + wire.duration, abs=1e-4)
    wire.boards[0].faults.mute = True
    talk(links, wire, references, 4)
    assert not link.fresh
    wire.boards[0].faults.mute = False
    talk(links, wire, references, 1)
    assert link.interval == pytest.approx(5e-3)


def test_a_board_that_timed_out_is_not_driven_again(links, wire, references):
    drive(links, wire, references)
    link = links[0]
    wire.boards[0].faults.mute = True
    talk(links, wire, references, 20, enable=True)
    assert link.may_be_damped
    assert link.is_damped_without_answer
    wire.trouble = 'the bus is gone'  # so nothing left for it
    wire.wait(2.0 * SETTINGS.board_timeout)
    talk(links, wire, references, 1, enable=True)
    assert not link.may_be_damped
    assert 'the bus is gone' in link.monitor.problem
    wire.trouble, wire.boards[0].faults.mute = '', False
    talk(links, wire, references, 1, enable=True)
    assert link.may_be_damped


def test_a_restart_of_a_board_is_detected_once(links, wire, references):
    drive(links, wire, references)
    wire.wait(0.2)
    talk(links, wire, references, 1, enable=True)
    wire.boards[1].power_cycle()
    talk(links, wire, references, 1, enable=True)
    assert [link.restarted for link in links] == [False, True]
    assert 'it may have restarted' in links[1].monitor.fault
    talk(links, wire, references, 1)
    assert not any(link.restarted for link in links)


def test_before_the_first_answer_nothing_is_known(links):
    for number, link in enumerate(links):
        assert link.monitor.name == f'board{number}'
        assert not link.fresh
        assert not link.restarted
        assert not link.may_be_damped
        assert link.interval == link.interval_max == math.inf


def test_every_frame_has_an_index_and_a_time_out(config, links, wire, references):
    drive(links, wire, references)
    talk(links, wire, references, 2)
    for board, link in enumerate(links):
        link.switch_off()
        link.switch_off()
        sent = wire.commands(board)
        assert [command.index for command in sent] == list(range(1, len(sent) + 1))
        strongest = [
            min(joint.effort_max / joint.torque_per_ampere, joint.motor.current_max)
            for joint in config.joints
            if joint.board == board
        ]
        for command in sent:
            assert command.timeout == pytest.approx(SETTINGS.board_timeout)
            assert command.current_saturation == pytest.approx(strongest, rel=0.01)
            assert command.enable_motor == [command.enable_system] * 2
        driven = [command.enable_system for command in sent]
        assert driven == [False] * 10 + [True] * 5 + [False] * 4


def test_an_integral_gain_is_sent_where_the_frame_carries_it(config):
    profile = load_profile('laas_power')
    wire = LoneBoards(config, profile)
    references = MotorReferences(config, profile, reach_max=0.5)
    references.set_gains(1.0, 0.6, 2.0)
    for motor in references.motors:
        motor.track(0.1, 0.0, math.nan, 0.1, 1e-3)
    links = make_links(config, profile, SETTINGS, wire)
    talk(links, wire, references, 1, enable=True)
    for board in (0, 1):
        assert wire.commands(board)[-1].integral_gain == pytest.approx([2.0, 2.0], rel=0.01)


@pytest.mark.parametrize(
    ('interval', 'hold'), [(1e-3, 1e-3), (0.0, 1e-5), (1.0, 5e-3), (math.inf, 5e-3)]
)
def test_measurements_are_in_joint_units_and_the_torque_is_the_mean_of_the_cycle(
    config, links, interval, hold
):
    joint = replace(config.joints[2], sign=-1, offset=0.3)
    measured = ArmMeasurements(
        replace(config, joints=(*config.joints[:2], joint, config.joints[3]))
    )
    link, channel = links[joint.board], joint.channel
    state, echo = link.state, link.monitor.echo
    state.position[channel], state.velocity[channel], state.current[channel] = 2.0, 30.0, 4.0
    state.quadrature_voltage[channel], state.index_toggle[channel] = 5.0, True
    link.monitor.good_frames, echo.rate, echo.unconfirmed = 1, 1.0, 3
    link.fresh = link.is_aligned = True
    link.interval, link.interval_max = interval, 2e-3
    zero, gains = np.full(4, 0.5), [(3.0, 0.2)] * 4
    measured.read([link], zero, gains, 1e-4)
    assert np.isnan(measured.q[:2]).all()
    assert measured.motor_position[2] == 1.5
    assert measured.q[2] == pytest.approx(0.3 - 1.5 * joint.gear.ratio)
    assert measured.dq[2] == pytest.approx(-30.0 * joint.gear.ratio)
    share = max(0.5 * hold - 1e-4, 0.0)
    mean = 4.0 + share * 3.0 * 30.0  # without a previous velocity
    assert measured.tau[2] == pytest.approx(-mean * joint.torque_per_ampere)
    assert (measured.motor_voltage[2], measured.reported_position[2]) == (5.0, 2.0)
    assert measured.index_toggle.tolist() == [False, False, True, False]
    for name in ('fresh', 'has_answered', 'driven'):
        assert getattr(measured, name) == [False, False, True, True]
    assert measured.unconfirmed == [0, 0, 3, 3]
    assert measured.interval_max[2:] == [2e-3, 2e-3]
    state.velocity[channel] = 31.0
    measured.read([link], zero, gains, 1e-4)
    mean = 4.0 + share * (3.0 * 31.0 + 0.2 / hold * 1.0)
    assert measured.tau[2] == pytest.approx(-mean * joint.torque_per_ampere)
    measured.read([link], zero, gains)  # the same states again
    assert measured.tau[2] == pytest.approx(-4.0 * joint.torque_per_ampere)
    link.fresh = link.is_aligned = False
    link.monitor.good_frames, echo.rate, state.velocity[channel] = 0, 0.0, 32.0
    measured.read([link], zero, gains, 1e-4)
    assert measured.unconfirmed == [0] * 4
    assert not any(measured.fresh + measured.has_answered + measured.driven)
    assert measured.motor_velocity[2] == 31.0


def test_age_and_reliable_motion_of_measurements(config):
    measured = ArmMeasurements(config)
    assert not any(measured.fresh + measured.has_answered + measured.driven)
    assert measured.unconfirmed == [0] * 4
    measured.fresh = [True, True, False, False]
    assert measured.age(2.0, 1.0) == ([1.0, 1.0, math.inf, math.inf], [math.inf] * 2 + [0.0] * 2)
    measured.fresh = [False, True, True, False]
    assert measured.age(0.5, 1.5)[0] == [0.0, 0.0, 0.0, math.inf]  # the clock went back
    assert measured.age(3.0, 2.5) == ([2.0, 0.5, 0.5, math.inf], [0.0, 1.0, 1.0, 0.0])
    measured.q[:], measured.dq[:] = [1.0, 2.0, 3.0, 4.0], 5.0
    assert measured.reliable_motion([True] * 4)[0].tolist() == [1.0, 2.0, 3.0, 4.0]
    measured.q[:] = 9.0
    q, dq = measured.reliable_motion([True, False, True, True])
    assert (q.tolist(), dq.tolist()) == ([9.0, 2.0, 9.0, 9.0], [5.0, 0.0, 5.0, 5.0])


def test_one_motor_alone_is_driven_and_waited_for(links, wire, references):
    talk(links, wire, references, 10)
    links[0].drive_only(1)
    wire.boards[0].motors[1].ready = True
    talk(links, wire, references, 3, enable=True)
    assert links[0].is_aligned
    assert [motor.enabled for motor in wire.boards[0].motors] == [False, True]
    links[0].drive_only(None)
    assert not links[0].is_aligned
    talk(links, wire, references, 1, enable=True)
    assert [motor.enabled for motor in wire.boards[0].motors] == [True, True]


def test_resistances_are_those_that_the_boards_report(links, wire, references):
    assert np.isnan(resistance_by_boards(links, 4)).all()
    wire.boards[1].motors[0].heat.warm(125.0)
    talk(links, wire, references, 2)
    true = [motor.heat.resistance for board in wire.boards for motor in board.motors]
    assert resistance_by_boards(links, 4) == pytest.approx(true, rel=0.01)
